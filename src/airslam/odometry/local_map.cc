// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/local_map.h"

#include <algorithm>
#include <set>

namespace airslam {

LocalMap::LocalMap(const MapCalibration& calibration, const LocalMapOptions& options,
                   double pixel_sigma, const LineOptions& lines)
    : options_(options), pixel_sigma_(pixel_sigma), lines_(lines, map_) {
  map_.calibration = calibration;
}

FeatureRef LocalMap::Source(LandmarkId id) const {
  const auto chosen = sources_.find(id);
  if (chosen != sources_.end() && images_.contains(chosen->second.keyframe)) return chosen->second;
  for (const FeatureRef& ref : seen_by_.at(id)) {
    if (images_.contains(ref.keyframe)) return ref;
  }
  return {};
}

LandmarkId LocalMap::AddLandmark(const Eigen::Vector3d& point_in_world) {
  const LandmarkId id = next_landmark_++;
  map_.landmarks[id] = {id, point_in_world, next_keyframe_};
  seen_by_[id] = {};
  return id;
}

void LocalMap::AddObservation(LandmarkId id, const FeatureRef& ref) {
  map_.keyframes.at(ref.keyframe).landmarks[ref.index] = id;
  Landmark& landmark = map_.landmarks.at(id);
  landmark.first_seen_by = std::min(landmark.first_seen_by, ref.keyframe);
  seen_by_.at(id).push_back(ref);
}

void LocalMap::AddKeyframe(Keyframe keyframe, const ImagePyramid& left_image) {
  const KeyframeId id = keyframe.id;
  next_keyframe_ = id + 1;
  if (!window_.empty() && last().component != keyframe.component) {
    window_.clear();
    images_.clear();
  }
  for (std::size_t i = 0; i < keyframe.landmarks.size(); ++i) {
    if (keyframe.landmarks[i] == kNoLandmark) continue;
    seen_by_.at(keyframe.landmarks[i]).push_back({id, static_cast<int>(i)});
  }
  lines_.AddKeyframe(keyframe);
  map_.keyframes[id] = std::move(keyframe);
  images_[id] = left_image;
  window_.push_back(id);
  if (window_.size() > static_cast<std::size_t>(options_.window)) {
    images_.erase(window_.front());
    window_.erase(window_.begin());
  }
}

BundleJob LocalMap::MakeBundleJob() const {
  BundleJob job;
  std::set<LandmarkId> landmarks;
  for (KeyframeId id : window_) {
    for (LandmarkId landmark : map_.keyframes.at(id).landmarks) {
      if (landmark != kNoLandmark) landmarks.insert(landmark);
    }
  }
  std::set<KeyframeId> anchors;  // keyframes before the window, the latest of them
  for (LandmarkId landmark : landmarks) {
    for (const FeatureRef& ref : seen_by_.at(landmark)) {
      if (ref.keyframe < window_.front()) anchors.insert(ref.keyframe);
    }
  }
  while (anchors.size() > static_cast<std::size_t>(options_.max_fixed)) {
    anchors.erase(anchors.begin());
  }

  std::map<KeyframeId, int> pose_index;
  const auto add_pose = [&](KeyframeId id, bool fixed) {
    pose_index[id] = static_cast<int>(job.keyframes.size());
    job.keyframes.push_back(id);
    job.problem.world_from_cam.push_back(map_.keyframes.at(id).world_from_cam);
    job.problem.pose_fixed.push_back(fixed);
  };
  for (KeyframeId id : anchors) add_pose(id, true);
  for (KeyframeId id : window_) add_pose(id, anchors.empty() && id == window_.front());
  job.problem.stereo = stereo();
  AddPoints(pose_index, std::vector<LandmarkId>(landmarks.begin(), landmarks.end()), job);
  lines_.AddTo(window_, pose_index, job);
  return job;
}

void LocalMap::AddPoints(const std::map<KeyframeId, int>& pose_of,
                         std::span<const LandmarkId> landmarks, BundleJob& job) const {
  for (LandmarkId landmark : landmarks) {
    std::vector<FeatureRef> refs = seen_by_.at(landmark);
    std::erase_if(refs, [&](const FeatureRef& r) { return !pose_of.contains(r.keyframe); });
    if (refs.size() == 1) {
      job.carried.emplace_back(landmark, refs.front().keyframe);
      continue;
    }
    const int point = static_cast<int>(job.landmarks.size());
    job.landmarks.push_back(landmark);
    job.problem.points_in_world.push_back(map_.landmarks.at(landmark).point_in_world);
    for (const FeatureRef& ref : refs) {
      const Keyframe& keyframe = map_.keyframes.at(ref.keyframe);
      const Keypoint& keypoint = keyframe.keypoints[ref.index];
      job.observations.push_back(ref);
      job.problem.observations.push_back(
          {pose_of.at(ref.keyframe), point,
           PointObservation{{keypoint.x, keypoint.y}, keyframe.right_x[ref.index], pixel_sigma_}});
    }
  }
}

void LocalMap::RemoveObservation(const FeatureRef& ref) {
  Keyframe& keyframe = map_.keyframes.at(ref.keyframe);
  std::vector<FeatureRef>& refs = seen_by_.at(keyframe.landmarks[ref.index]);
  std::erase_if(refs, [&](const FeatureRef& r) { return r.keyframe == ref.keyframe; });
  keyframe.landmarks[ref.index] = kNoLandmark;
}

std::map<KeyframeId, Rigid3> LocalMap::Moves(const BundleJob& solved) const {
  std::map<KeyframeId, Rigid3> new_from_old;
  for (std::size_t i = 0; i < solved.keyframes.size(); ++i) {
    new_from_old[solved.keyframes[i]] =
        solved.problem.world_from_cam[i] *
        map_.keyframes.at(solved.keyframes[i]).world_from_cam.Inverse();
  }
  return new_from_old;
}

void LocalMap::RemoveUnseenLandmarks(std::span<const LandmarkId> candidates,
                                     MapWriter::Update& update) {
  for (LandmarkId id : candidates) {
    if (!seen_by_.at(id).empty()) continue;
    seen_by_.erase(id);
    sources_.erase(id);
    map_.landmarks.erase(id);
    update.removed_landmarks.push_back(id);
  }
}

void LocalMap::ApplyStates(const BundleJob& solved, MapWriter::Update& update) {
  for (std::size_t i = 0; i < solved.keyframes.size(); ++i) {
    if (solved.problem.pose_fixed[i]) continue;
    const Rigid3& pose = solved.problem.world_from_cam[i];
    map_.keyframes.at(solved.keyframes[i]).world_from_cam = pose;
    update.world_from_cam.emplace_back(solved.keyframes[i], pose);
  }
  for (const InertialTerms::State& state : solved.problem.inertial.states) {
    Keyframe& keyframe = map_.keyframes.at(solved.keyframes[state.pose]);
    keyframe.velocity_in_world = state.velocity_in_world;
    keyframe.gyroscope_bias = state.bias.gyroscope;
    keyframe.accelerometer_bias = state.bias.accelerometer;
    update.inertial_states.push_back(
        {keyframe.id, state.velocity_in_world, state.bias.gyroscope, state.bias.accelerometer});
  }
}

MapWriter::Update LocalMap::Apply(const BundleJob& solved) {
  MapWriter::Update update;
  const std::map<KeyframeId, Rigid3> new_from_old = Moves(solved);
  for (const auto& [landmark, keyframe] : solved.carried) {
    Eigen::Vector3d& point = map_.landmarks.at(landmark).point_in_world;
    point = new_from_old.at(keyframe) * point;
  }
  ApplyStates(solved, update);
  std::set<KeyframeId> changed;
  for (std::size_t i = 0; i < solved.observations.size(); ++i) {
    if (!solved.summary.outlier[i]) continue;
    RemoveObservation(solved.observations[i]);
    changed.insert(solved.observations[i].keyframe);
  }
  for (std::size_t i = 0; i < solved.landmarks.size(); ++i) {
    map_.landmarks.at(solved.landmarks[i]).point_in_world = solved.problem.points_in_world[i];
  }
  RemoveUnseenLandmarks(solved.landmarks, update);
  for (LandmarkId id : solved.landmarks) {
    if (map_.landmarks.contains(id)) update.landmarks.push_back(map_.landmarks.at(id));
  }
  for (const auto& [id, keyframe] : solved.carried) {
    update.landmarks.push_back(map_.landmarks.at(id));
  }
  for (KeyframeId id : changed) {
    update.keyframe_landmarks.emplace_back(id, map_.keyframes.at(id).landmarks);
  }
  lines_.Apply(solved, new_from_old, update);
  return update;
}

}  // namespace airslam
