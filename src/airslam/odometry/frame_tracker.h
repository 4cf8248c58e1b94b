// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "airslam/feature/image_pyramid.h"
#include "airslam/map/keyframe.h"
#include "airslam/neural/feature_matcher.h"
#include "airslam/odometry/frame_features.h"
#include "airslam/odometry/local_map.h"
#include "airslam/odometry/options.h"
#include "airslam/optimize/pose_optimization.h"

namespace airslam {

// A landmark of the keyframe, found in the current frame.
struct TrackedPoint {
  int keyframe_index = -1;  // keypoint of the keyframe
  LandmarkId landmark = kNoLandmark;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  bool by_source = true;  // aligned to the patch that defines the landmark
};

// Pose of a frame with the points that hold it.
struct TrackedFrame {
  KeyframeId keyframe = -1;  // it was tracked against
  Rigid3 world_from_cam;
  std::vector<TrackedPoint> points;  // inliers of the final pose
  int in_sight = 0;                  // landmarks of the keyframe that lie in the image
  double mean_parallax = 0;          // pixels, mean displacement from the keyframe
  double rms = 0;                    // pixels in sigmas
  bool used_matcher = false;         // the learned matcher was needed
};

// The current frame as the tracker sees it.
struct FrameView {
  const ImagePyramid& image;  // rectified left
  const FrameFeatures& features;
};

// Matches frames with keyframes and estimates their poses (paper, sections V-B and V-D). A first
// pose comes from the landmarks' coarse patches around their predicted places; then every landmark
// of the keyframe is sought at its place under that pose and aligned to sub-pixel accuracy, and the
// pose optimized once more. Only where too little of the keyframe is found so, features are looked
// for in the image: poses from those near their predicted places, by descriptor and PnP-RANSAC, and
// from the learned matcher compete with the first. Holds no state.
class FrameTracker {
 public:
  FrameTracker(const TrackingOptions& options, const LocalMap& map, FeatureMatcher& matcher)
      : options_(options), map_(map), matcher_(matcher) {}

  // Tracks against `keyframe`, starting at the predicted pose. Nothing when too few points agree.
  std::optional<TrackedFrame> Track(const FrameView& frame, const Keyframe& keyframe,
                                    const PosePrior& prediction) const;

  // Finds the frame's pose from the learned matcher alone, without a prediction.
  std::optional<TrackedFrame> Relocate(const FrameView& frame, const Keyframe& keyframe,
                                       const RecoveryOptions& recovery) const;

  // A landmark's patch found in an image.
  struct Found {
    Eigen::Vector2d pixel;
    double sigma;  // standard deviation in pixels
  };
  // Seeks a landmark at its place under `world_from_cam`, by the patch of `source`, first at the
  // pyramid's level `first`, then at coarser ones up to `last`, where noise is weaker. Nothing when
  // it is out of sight or looks different.
  std::optional<Found> Seek(const ImagePyramid& image, const Rigid3& world_from_cam,
                            LandmarkId landmark, const FeatureRef& source, int first,
                            int last) const;

 private:
  std::vector<Match> MatchNearPrediction(const FrameView& frame, const Keyframe& keyframe,
                                         const Rigid3& world_from_cam) const;
  // Whether a pose explains so much of the image that no other need be tried.
  bool IsConvincing(const TrackedFrame& tracked) const;
  // Where the keyframe's landmarks lie in the image, those that do.
  std::vector<Eigen::Vector2d> InSight(const Keyframe& keyframe,
                                       const Rigid3& world_from_cam) const;
  std::vector<Match> MatchLearned(const FrameView& frame, const Keyframe& keyframe) const;
  PoseOptimizationResult PoseFromMatches(const FrameView& frame, const Keyframe& keyframe,
                                         const std::vector<Match>& matches) const;
  PoseOptimizationResult PoseFromCoarsePatches(const FrameView& frame, const Keyframe& keyframe,
                                               const PosePrior& prediction) const;
  std::optional<TrackedFrame> AlignAndOptimize(const FrameView& frame, const Keyframe& keyframe,
                                               const Rigid3& world_from_cam,
                                               const std::optional<PosePrior>& prior) const;
  std::optional<TrackedFrame> AlignAtLevels(const FrameView& frame, const Keyframe& keyframe,
                                            const Rigid3& world_from_cam,
                                            const std::optional<PosePrior>& prior,
                                            int last_level) const;

  const TrackingOptions& options_;
  const LocalMap& map_;
  FeatureMatcher& matcher_;
};

}  // namespace airslam
