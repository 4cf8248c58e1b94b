// SPDX-License-Identifier: BSD-3-Clause
#include "remove_low_quality.h"

#include <set>

#include "airslam/refine/map_tools.h"

namespace {

// Mean distance between where keyframes saw the landmark and where it is, pixels.
double MeanError(const airslam::Map& map, const airslam::Landmark& landmark,
                 const std::vector<airslam::FeatureRef>& observations) {
  double sum = 0;
  for (const auto& [keyframe_id, index] : observations) {
    const airslam::Keyframe& keyframe = map.keyframes.at(keyframe_id);
    const Eigen::Vector3d point = keyframe.world_from_cam.Inverse() * landmark.point_in_world;
    const airslam::Keypoint& seen = keyframe.keypoints[index];
    sum += (map.calibration.stereo.camera.Project(point) - Eigen::Vector2d(seen.x, seen.y)).norm();
  }
  return sum / static_cast<double>(observations.size());
}

}  // namespace

void RemoveLowQuality::Process(airslam::Map& map, airslam::RefineContext& context) {
  std::set<airslam::LandmarkId> bad;
  const auto observations = airslam::CollectObservations(map);
  int done = 0;
  for (const auto& [id, seen_by] : observations) {
    context.progress(++done, static_cast<int>(observations.size()), "landmarks");
    const bool good = static_cast<int>(seen_by.size()) >= kMinKeyframes &&
                      MeanError(map, map.landmarks.at(id), seen_by) <= kMaxError;
    if (!good) bad.insert(id);
  }
  for (auto& [id, keyframe] : map.keyframes) {
    for (airslam::LandmarkId& named : keyframe.landmarks) {
      if (bad.contains(named)) named = airslam::kNoLandmark;
    }
  }
  airslam::RemoveUnseenLandmarks(map);
  context.report["removed"] = bad.size();
}
