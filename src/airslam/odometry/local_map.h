// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <opencv2/core.hpp>
#include <span>
#include <utility>
#include <vector>

#include "airslam/feature/image_pyramid.h"
#include "airslam/map/map.h"
#include "airslam/map/map_file.h"
#include "airslam/odometry/options.h"
#include "airslam/optimize/bundle.h"

namespace airslam {

// A landmark's place in a keyframe: keypoint `index` of keyframe `keyframe`.
struct KeypointRef {
  KeyframeId keyframe = -1;
  int index = -1;
};

// One local bundle adjustment: a copy of what it needs, and whom its parts belong to. Solving it
// touches nothing else, so it may run on another thread.
struct BundleJob {
  std::vector<KeyframeId> keyframes;      // of problem.world_from_cam
  std::vector<LandmarkId> landmarks;      // of problem.points_in_world
  std::vector<KeypointRef> observations;  // of problem.observations
  // Landmarks that only one of the keyframes sees: they say nothing about poses, and go along with
  // that keyframe.
  std::vector<std::pair<LandmarkId, KeyframeId>> carried;
  BundleProblem problem;
  BundleSummary summary;
};

// The map while it grows: keyframes, landmarks, who sees whom, and the images of the latest
// keyframes, whose patches later frames are aligned to. One thread owns it.
class LocalMap {
 public:
  LocalMap(const MapCalibration& calibration, const LocalMapOptions& options, double pixel_sigma);

  const Map& map() const { return map_; }
  Map& map() { return map_; }
  const StereoCamera& stereo() const { return map_.calibration.stereo; }

  bool empty() const { return window_.empty(); }
  // The latest keyframe of the current component.
  const Keyframe& last() const { return map_.keyframes.at(window_.back()); }
  // The latest keyframes of the current component, oldest first.
  std::span<const KeyframeId> window() const { return window_; }
  // Rectified left image of a keyframe in the window.
  const ImagePyramid& image(KeyframeId id) const { return images_.at(id); }
  // The patch that defines the landmark: later frames are aligned to it, so that its track does not
  // drift. It is the first observation, unless SetSource chose a later one, within the window. The
  // keyframe is negative when none of the landmark's observers has an image any more.
  KeypointRef Source(LandmarkId id) const;
  // The landmark looks too different from its earlier patches: this one defines it from now on.
  void SetSource(LandmarkId id, const KeypointRef& source) { sources_[id] = source; }
  const std::vector<KeypointRef>& observations(LandmarkId id) const { return seen_by_.at(id); }

  KeyframeId next_keyframe_id() const { return next_keyframe_; }
  LandmarkId AddLandmark(const Eigen::Vector3d& point_in_world);
  // A keyframe of the map sees a landmark that was added after it. Call in order of keyframes.
  void AddObservation(LandmarkId id, const KeypointRef& ref);
  // keyframe.id must be next_keyframe_id(). A keyframe of a new component empties the window.
  void AddKeyframe(Keyframe keyframe, const ImagePyramid& left_image);

  // The bundle of the window, held by older keyframes that see the same landmarks.
  BundleJob MakeBundleJob() const;
  // Takes over a solved job. The map must not have changed since it was made. Returns what changed.
  MapWriter::Update Apply(const BundleJob& solved);

 private:
  void MoveCarried(const BundleJob& solved);
  void RemoveObservation(const KeypointRef& ref);
  void RemoveUnseenLandmarks(std::span<const LandmarkId> candidates, MapWriter::Update& update);

  LocalMapOptions options_;
  double pixel_sigma_;
  Map map_;
  std::map<LandmarkId, std::vector<KeypointRef>> seen_by_;  // oldest first
  std::map<LandmarkId, KeypointRef> sources_;               // where not the first observation
  std::vector<KeyframeId> window_;
  std::map<KeyframeId, ImagePyramid> images_;
  KeyframeId next_keyframe_ = 0;
  LandmarkId next_landmark_ = 0;
};

}  // namespace airslam
