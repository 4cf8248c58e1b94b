// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>
#include <vector>

#include "airslam/geometry/pinhole.h"
#include "airslam/map/map.h"
#include "airslam/neural/feature_matcher.h"
#include "airslam/optimize/pnp_ransac.h"
#include "airslam/optimize/pose_optimization.h"

namespace airslam {

// An image's features and the camera, without distortion, that saw them. The data must outlive it.
struct PlaceView {
  std::span<const Keypoint> keypoints;
  const DescriptorMatrix& descriptors;
  Pinhole camera;
};

struct VerificationOptions {
  PnpRansacOptions ransac;
  PoseOptimizationOptions pose;
  // Standard deviation of a keypoint in pixels: keypoints lie on whole pixels, and those of a night
  // and a day image differ by about one.
  double pixel_sigma = 1.0;

  // Throws Error that names the wrong field.
  void Validate() const;
};

// A landmark of a keyframe, seen again.
struct PlaceInlier {
  int keypoint = -1;           // of the view
  int keyframe_keypoint = -1;  // of the keyframe
  LandmarkId landmark = kNoLandmark;
};

// What comparing a view with a keyframe has shown.
struct PlaceMatch {
  KeyframeId keyframe = -1;
  int matches = 0;                   // with landmarks of the keyframe
  std::vector<PlaceInlier> inliers;  // of the final pose; empty: there is no pose
  Rigid3 world_from_cam;             // of the view
  // Of the pose, in PosePrior's order: rotation about the camera's axes (rad), position in world
  // (m). The inverse information of the inliers, times their mean squared residual where that is
  // larger than pixel_sigma lets expect.
  Matrix6d covariance = Matrix6d::Zero();
  double rms = 0;  // of the inliers' pixel distances, in sigmas
};

// Matches a view with a keyframe, finds the view's pose by PnP-RANSAC on the landmarks that the
// keyframe sees, and refines it (paper, section VI-A for loops, VI-B for localization). How many
// inliers make it a loop or a place is the caller's to say. Deterministic. The matcher is used by
// one thread at a time; the map is only read.
PlaceMatch VerifyPlace(const PlaceView& view, const Map& map, const Keyframe& keyframe,
                       FeatureMatcher& matcher, const VerificationOptions& options);

}  // namespace airslam
