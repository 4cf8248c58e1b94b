// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/refine/map_tools.h"

#include <algorithm>
#include <cmath>
#include <set>

namespace airslam {

std::map<LandmarkId, std::vector<FeatureRef>> CollectObservations(const Map& map) {
  std::map<LandmarkId, std::vector<FeatureRef>> seen_by;
  for (const auto& [id, keyframe] : map.keyframes) {
    for (std::size_t i = 0; i < keyframe.landmarks.size(); ++i) {
      if (keyframe.landmarks[i] == kNoLandmark) continue;
      std::vector<FeatureRef>& list = seen_by[keyframe.landmarks[i]];
      if (list.empty() || list.back().keyframe != id) list.push_back({id, static_cast<int>(i)});
    }
  }
  return seen_by;
}

void MoveKeyframes(const std::map<KeyframeId, Rigid3>& world_from_cam, Map& map) {
  std::map<KeyframeId, Rigid3> new_from_old;  // in world
  for (const auto& [id, pose] : world_from_cam) {
    Keyframe& keyframe = map.keyframes.at(id);
    const Rigid3 change = pose * keyframe.world_from_cam.Inverse();
    new_from_old[id] = change;
    keyframe.world_from_cam = pose;
    keyframe.velocity_in_world = change.rotation * keyframe.velocity_in_world;
  }
  for (auto& [id, landmark] : map.landmarks) {
    const auto change = new_from_old.find(landmark.first_seen_by);
    if (change == new_from_old.end()) continue;
    landmark.point_in_world = change->second * landmark.point_in_world;
  }
  for (auto& [id, line] : map.line_landmarks) {
    const auto change = new_from_old.find(line.first_seen_by);
    if (change == new_from_old.end()) continue;
    line.ends_in_world.start = change->second * line.ends_in_world.start;
    line.ends_in_world.end = change->second * line.ends_in_world.end;
  }
}

int RemoveUnseenLandmarks(Map& map) {
  std::set<LandmarkId> seen, seen_lines;
  for (const auto& [id, keyframe] : map.keyframes) {
    seen.insert(keyframe.landmarks.begin(), keyframe.landmarks.end());
    seen_lines.insert(keyframe.line_landmarks.begin(), keyframe.line_landmarks.end());
  }
  std::erase_if(map.line_landmarks,
                [&](const auto& entry) { return !seen_lines.contains(entry.first); });
  return static_cast<int>(
      std::erase_if(map.landmarks, [&](const auto& entry) { return !seen.contains(entry.first); }));
}

MapErrors MeasureErrors(const Map& map) {
  MapErrors errors;
  std::set<int> components;
  std::vector<double> distances;
  double squares = 0;
  for (const auto& [id, keyframe] : map.keyframes) {
    components.insert(keyframe.component);
    const Rigid3 cam_from_world = keyframe.world_from_cam.Inverse();
    for (std::size_t i = 0; i < keyframe.landmarks.size(); ++i) {
      const auto landmark = map.landmarks.find(keyframe.landmarks[i]);
      if (landmark == map.landmarks.end()) continue;
      ++errors.observations;
      const Eigen::Vector3d point = cam_from_world * landmark->second.point_in_world;
      if (point.z() <= 0) continue;
      const Keypoint& keypoint = keyframe.keypoints[i];
      distances.push_back(
          (map.calibration.stereo.camera.Project(point) - Eigen::Vector2d(keypoint.x, keypoint.y))
              .norm());
      squares += distances.back() * distances.back();
    }
  }
  errors.keyframes = static_cast<int>(map.keyframes.size());
  errors.components = static_cast<int>(components.size());
  errors.landmarks = static_cast<std::int64_t>(map.landmarks.size());
  if (distances.empty()) return errors;
  errors.rms_error = std::sqrt(squares / static_cast<double>(distances.size()));
  std::nth_element(distances.begin(), distances.begin() + distances.size() / 2, distances.end());
  errors.median_error = distances[distances.size() / 2];
  return errors;
}

}  // namespace airslam
