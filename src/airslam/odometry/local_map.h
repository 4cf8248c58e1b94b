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
#include "airslam/odometry/bundle_job.h"
#include "airslam/odometry/local_lines.h"
#include "airslam/odometry/options.h"

namespace airslam {

// The map while it grows: keyframes, landmarks, who sees whom, and the images of the latest
// keyframes, whose patches later frames are aligned to. One thread owns it.
class LocalMap {
 public:
  LocalMap(const MapCalibration& calibration, const LocalMapOptions& options, double pixel_sigma,
           const LineOptions& lines = {});
  LocalMap(const LocalMap&) = delete;
  LocalMap& operator=(const LocalMap&) = delete;

  const Map& map() const { return map_; }
  Map& map() { return map_; }
  LocalLines& lines() { return lines_; }
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
  FeatureRef Source(LandmarkId id) const;
  // The landmark looks too different from its earlier patches: this one defines it from now on.
  void SetSource(LandmarkId id, const FeatureRef& source) { sources_[id] = source; }
  const std::vector<FeatureRef>& observations(LandmarkId id) const { return seen_by_.at(id); }

  KeyframeId next_keyframe_id() const { return next_keyframe_; }
  LandmarkId AddLandmark(const Eigen::Vector3d& point_in_world);
  // A keyframe of the map sees a landmark that was added after it. Call in order of keyframes.
  void AddObservation(LandmarkId id, const FeatureRef& ref);
  // keyframe.id must be next_keyframe_id(). A keyframe of a new component empties the window.
  void AddKeyframe(Keyframe keyframe, const ImagePyramid& left_image);

  // The bundle of the window, held by older keyframes that see the same landmarks.
  BundleJob MakeBundleJob() const;
  // Takes over a solved job. The map must not have changed since it was made. Returns what changed.
  MapWriter::Update Apply(const BundleJob& solved);

 private:
  void AddPoints(const std::map<KeyframeId, int>& pose_of, std::span<const LandmarkId> landmarks,
                 BundleJob& job) const;
  // How each keyframe of a solved job moves, in world. Before its poses are taken over.
  std::map<KeyframeId, Rigid3> Moves(const BundleJob& solved) const;
  void ApplyStates(const BundleJob& solved, MapWriter::Update& update);
  void RemoveObservation(const FeatureRef& ref);
  void RemoveUnseenLandmarks(std::span<const LandmarkId> candidates, MapWriter::Update& update);

  LocalMapOptions options_;
  double pixel_sigma_;
  Map map_;
  LocalLines lines_;
  std::map<LandmarkId, std::vector<FeatureRef>> seen_by_;  // oldest first
  std::map<LandmarkId, FeatureRef> sources_;               // where not the first observation
  std::vector<KeyframeId> window_;
  std::map<KeyframeId, ImagePyramid> images_;
  KeyframeId next_keyframe_ = 0;
  LandmarkId next_landmark_ = 0;
};

}  // namespace airslam
