// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "airslam/feature/guided_matching.h"
#include "airslam/feature/patch_alignment.h"
#include "airslam/feature/stereo_matching.h"
#include "airslam/odometry/inertial_options.h"
#include "airslam/odometry/line_options.h"
#include "airslam/optimize/bundle.h"
#include "airslam/optimize/pose_optimization.h"

namespace airslam {

// How a frame is matched with the last keyframe.
struct TrackingOptions {
  // Pixels around a feature's predicted place, as a share of the image width, in (0, 1].
  double search_radius = 0.06;
  // Cosine of descriptors below which two features are not the same, in [-1, 1].
  double min_similarity = 0.6;
  // Pixels: PnP-RANSAC's bound on the re-projection error, > 0.
  double ransac_error = 4.0;
  // Where the pose from features near their predicted place rests on fewer of them, or finds fewer
  // points, than this, > 0,
  int min_convincing = 40;
  // or a smaller share of the landmarks in sight than this, in [0, 1], the learned matcher (and in
  // the dark, coarse patches) may know a better one.
  double min_found_share = 0.5;
  // With fewer points the frame is lost, >= 6.
  int min_tracked = 15;
  // With fewer points aligned at full resolution than this, patches at half resolution, where noise
  // is weaker, count as well, >= 0.
  int coarse_below = 80;
  // Standard deviation of an aligned patch's position in pixels, > 0.
  double pixel_sigma = 0.4;
  // Zero-mean normalised correlation that an aligned patch needs, in (0, 1).
  double min_correlation = 0.75;

  template <class V>
  void Visit(V& v) {
    v.Field("search_radius", search_radius);
    v.Field("min_similarity", min_similarity);
    v.Field("ransac_error", ransac_error);
    v.Field("min_convincing", min_convincing);
    v.Field("min_found_share", min_found_share);
    v.Field("min_tracked", min_tracked);
    v.Field("coarse_below", coarse_below);
    v.Field("pixel_sigma", pixel_sigma);
    v.Field("min_correlation", min_correlation);
  }
};

// When a frame becomes a keyframe (paper, section V-C).
struct KeyframeOptions {
  // alpha_1: fewer tracked points than this share of the last keyframe's landmarks, in (0, 1).
  double min_tracked_share = 0.65;
  // alpha_2: mean parallax to the last keyframe above this share of sqrt(width * height), > 0.
  double max_parallax = 0.1;
  // N_kf: fewer tracked points than this, > 0.
  int min_tracked = 100;
  // Pixels: a new landmark keeps this distance from the tracked ones, >= 0.
  double min_spacing = 6.0;

  template <class V>
  void Visit(V& v) {
    v.Field("min_tracked_share", min_tracked_share);
    v.Field("max_parallax", max_parallax);
    v.Field("min_tracked", min_tracked);
    v.Field("min_spacing", min_spacing);
  }
};

// Local bundle adjustment (paper, section V-D).
struct LocalMapOptions {
  // N_o: the latest keyframes that are optimized, >= 2.
  int window = 10;
  // Older keyframes that see the same landmarks and hold the window in place, >= 1.
  int max_fixed = 10;
  // A keyframe's adjustment is used from this many frames later on, >= 1 (the same on every run).
  int lag_frames = 2;
  // Iterations of each of the two rounds (before and after outliers are rejected), 1..100. Few are
  // enough, for each keyframe goes on from where the last one's adjustment ended.
  int iterations = 3;

  template <class V>
  void Visit(V& v) {
    v.Field("window", window);
    v.Field("max_fixed", max_fixed);
    v.Field("lag_frames", lag_frames);
    v.Field("iterations", iterations);
  }
};

// What to do when tracking is lost.
struct RecoveryOptions {
  // How many of the latest keyframes are tried, >= 1.
  int keyframes = 5;
  // Points that a recovered pose needs, both as PnP inliers and as aligned patches, >= 6.
  int min_inliers = 25;
  // Share, in [0, 1], of the image cells (64 x 64 pixels) with landmarks of the keyframe in sight
  // under a recovered pose in which points must be found: a wrong pose may please many matches on
  // one checkerboard, but not the image around it.
  double min_found_share = 0.2;
  // After this many lost frames a new component is started, >= 1.
  int lost_frames = 3;
  // Stereo points that the first keyframe of a component needs, > 0.
  int min_stereo_points = 40;

  template <class V>
  void Visit(V& v) {
    v.Field("keyframes", keyframes);
    v.Field("min_inliers", min_inliers);
    v.Field("min_found_share", min_found_share);
    v.Field("lost_frames", lost_frames);
    v.Field("min_stereo_points", min_stereo_points);
  }
};

// Everything that `airslam map --config` can change.
struct OdometryOptions {
  // Keypoints detected in an image (paper: 350 for mapping), in [50, 2000].
  int max_keypoints = 350;
  TrackingOptions tracking;
  KeyframeOptions keyframe;
  LocalMapOptions local_map;
  RecoveryOptions recovery;
  InertialOptions inertial;
  LineOptions lines;

  template <class V>
  void Visit(V& v) {
    v.Field("max_keypoints", max_keypoints);
    v.Group("tracking", tracking);
    v.Group("keyframe", keyframe);
    v.Group("local_map", local_map);
    v.Group("recovery", recovery);
    v.Group("inertial", inertial);
    v.Group("lines", lines);
  }

  // Throws Error that names the first field out of its range.
  void Validate() const;
};

}  // namespace airslam
