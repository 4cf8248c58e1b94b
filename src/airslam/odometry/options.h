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
  double search_radius = 0.06;
  double min_similarity = 0.6;
  double ransac_error = 4.0;
  int min_convincing = 40;
  double min_found_share = 0.5;
  int min_tracked = 15;
  int coarse_below = 80;
  double pixel_sigma = 0.4;
  double min_correlation = 0.75;

  template <class V>
  void Visit(V& v) {
    v.Field("search_radius", search_radius, {0.001, 1, "image widths"},
            "Around a feature's predicted place.");
    v.Field("min_similarity", min_similarity, {-1, 1},
            "Cosine of descriptors below which two features are not the same.");
    v.Field("ransac_error", ransac_error, {0.1, 100, "px"},
            "PnP-RANSAC's bound on the re-projection error.");
    v.Field("min_convincing", min_convincing, {1, 2000},
            "Where the pose from the landmarks' coarse patches finds fewer points, features are "
            "detected and matched near their predicted places; where that pose rests on fewer "
            "of them, or finds fewer points, the learned matcher may know a better one.");
    v.Field("min_found_share", min_found_share, {0, 1},
            "Likewise where a pose finds a smaller share of the landmarks in sight.");
    v.Field("min_tracked", min_tracked, {6, 2000}, "With fewer points the frame is lost.");
    v.Field("coarse_below", coarse_below, {0, 2000},
            "With fewer points aligned at full resolution than this, patches at half resolution, "
            "where noise is weaker, count as well.");
    v.Field("pixel_sigma", pixel_sigma, {0.01, 10, "px"},
            "Standard deviation of an aligned patch's position.");
    v.Field("min_correlation", min_correlation, {0.01, 0.99},
            "Zero-mean normalised correlation that an aligned patch needs.");
  }
};

// When a frame becomes a keyframe (paper, section V-D).
struct KeyframeOptions {
  double min_tracked_share = 0.65;
  double max_parallax = 0.1;
  int min_tracked = 100;
  double min_spacing = 6.0;

  template <class V>
  void Visit(V& v) {
    v.Field("min_tracked_share", min_tracked_share, {0.01, 0.99},
            "alpha_1: fewer tracked points than this share of the last keyframe's landmarks.");
    v.Field("max_parallax", max_parallax, {0.001, 10, "sqrt(width * height)"},
            "alpha_2: a larger mean parallax to the last keyframe.");
    v.Field("min_tracked", min_tracked, {1, 2000}, "N_kf: fewer tracked points than this.");
    v.Field("min_spacing", min_spacing, {0, 100, "px"},
            "A new landmark keeps this distance from the tracked ones.");
  }
};

// Local bundle adjustment (paper, section V-E).
struct LocalMapOptions {
  int window = 10;
  int max_fixed = 10;
  int lag_frames = 2;
  int iterations = 3;
  double least_scale = 0.25;

  template <class V>
  void Visit(V& v) {
    v.Field("window", window, {2, 100}, "N_o: the latest keyframes that are optimized.");
    v.Field("max_fixed", max_fixed, {1, 1000},
            "Older keyframes that see the same landmarks and hold the window in place.");
    v.Field(
        "lag_frames", lag_frames, {1, 100},
        "A keyframe's adjustment is used from this many frames later on (the same on every run).");
    v.Field("iterations", iterations, {1, 100},
            "Of each of the two rounds (before and after outliers are rejected). Few are enough, "
            "for each keyframe goes on from where the last one's adjustment ended.");
    v.Field("least_scale", least_scale, {0.01, 1},
            "Where residuals are smaller than `pixel_sigma` says, the bounds beyond which they "
            "count less or not at all shrink with them, to this share at the least.");
  }
};

// What to do when tracking is lost.
struct RecoveryOptions {
  int keyframes = 5;
  int min_inliers = 25;
  double min_found_share = 0.2;
  int lost_frames = 3;
  int min_stereo_points = 40;

  template <class V>
  void Visit(V& v) {
    v.Field("keyframes", keyframes, {1, 100}, "How many of the latest keyframes are tried.");
    v.Field("min_inliers", min_inliers, {6, 2000},
            "Points that a recovered pose needs, both as PnP inliers and as aligned patches.");
    v.Field("min_found_share", min_found_share, {0, 1},
            "Share of the image cells (64 x 64 pixels) with landmarks of the keyframe in sight "
            "under a recovered pose in which points must be found: a wrong pose may please many "
            "matches on one checkerboard, but not the image around it.");
    v.Field("lost_frames", lost_frames, {1, 100000},
            "After this many lost frames a new component is started.");
    v.Field("min_stereo_points", min_stereo_points, {6, 2000},
            "Stereo points that the first keyframe of a component needs.");
  }
};

// Everything that `airslam map --config` can change. What each field means stands in Visit.
struct OdometryOptions {
  int max_keypoints = 350;
  TrackingOptions tracking;
  KeyframeOptions keyframe;
  LocalMapOptions local_map;
  RecoveryOptions recovery;
  InertialOptions inertial;
  LineOptions lines;

  template <class V>
  void Visit(V& v) {
    v.Field("max_keypoints", max_keypoints, {50, 2000},
            "Keypoints detected in an image (paper: 350 for mapping).");
    v.Group("tracking", tracking, "How a frame is matched with the last keyframe.");
    v.Group("keyframe", keyframe, "When a frame becomes a keyframe (paper, section V-D).");
    v.Group("local_map", local_map, "Local bundle adjustment (paper, section V-E).");
    v.Group("recovery", recovery, "What to do when tracking is lost.");
    v.Group("inertial", inertial, "How the IMU is used.");
    v.Group("lines", lines, "Lines of keyframes (paper, sections V-B, V-C and V-E).");
  }

  // Throws Error that names the first field out of its range.
  void Validate() const;
};

}  // namespace airslam
