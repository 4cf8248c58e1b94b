// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

namespace airslam {

// Finding places that were visited before (paper, section VI-A).
struct LoopClosureOptions {
  double min_score_share = 0.3;
  int min_shared_in_group = 10;
  int max_groups = 3;
  int min_inliers = 50;
  double pixel_sigma = 1.0;
  double ransac_error = 4.0;
  double max_disagreement = 0.03;
  double max_disagreement_angle = 0.02;
  double max_drift = 0.05;
  double max_drift_angle = 0.2;
  int min_joining_loops = 3;

  template <class V>
  void Visit(V& v) {
    v.Field("min_score_share", min_score_share, {0, 0.99},
            "Of the best score of earlier keyframes: below it no candidate.");
    v.Field("min_shared_in_group", min_shared_in_group, {0, 100000},
            "Keyframes that share more landmarks than this form a group.");
    v.Field("max_groups", max_groups, {1, 1000},
            "Of so many of the best groups one keyframe each is matched.");
    v.Field("min_inliers", min_inliers, {6, 10000}, "A loop has more inliers than this.");
    v.Field("pixel_sigma", pixel_sigma, {0.01, 100, "px"}, "Standard deviation of a keypoint.");
    v.Field("ransac_error", ransac_error, {0.1, 100, "px"}, "What RANSAC takes for an inlier.");
    v.Field("max_disagreement", max_disagreement, {0.0001, 10},
            "The pose is found a second time from the other keyframe's points: both must agree "
            "within this share of the points' median depth.");
    v.Field("max_disagreement_angle", max_disagreement_angle, {0.0001, 3.15, "rad"},
            "Both poses must agree within this angle.");
    v.Field("max_drift", max_drift, {0.0001, 1000},
            "A loop that would move a keyframe by more than half a metre and this share of the "
            "path since the other one is not believed: odometry does not drift so much, but places "
            "look alike.");
    v.Field("max_drift_angle", max_drift_angle, {0.0001, 3.15, "rad"},
            "Nor is a loop that would turn it by more.");
    v.Field("min_joining_loops", min_joining_loops, {1, 100000},
            "Two components become one when so many loops between them agree.");
  }
};

// Making one of landmarks that are the same (paper, section VI-A).
struct MergeOptions {
  int min_shared_points = 3;

  template <class V>
  void Visit(V& v) {
    v.Field("min_shared_points", min_shared_points, {1, 10000},
            "Lines that share more points than this are one.");
  }
};

// Pose graph (paper, section VI-A): spreads what loops say over the path.
struct PoseGraphProcessorOptions {
  int iterations = 50;
  int min_landmarks = 0;
  double position_share = 0.005;
  double position_sigma = 0.002;
  double rotation_sigma = 0.001;

  template <class V>
  void Visit(V& v) {
    v.Field("iterations", iterations, {1, 10000}, "Of Levenberg-Marquardt, at most.");
    v.Field("min_landmarks", min_landmarks, {0, 1e9},
            "Maps with fewer landmarks go straight to bundle adjustment. (The paper: 80,000, since "
            "its bundle adjustment copes with the drift of smaller maps. A pose graph takes "
            "milliseconds, and with it bundle adjustment starts near its end.)");
    v.Field("position_share", position_share, {1e-6, 10},
            "Standard deviation of the position of one keyframe in the next: this share of the way "
            "between them, and `position_sigma` beside it.");
    v.Field("position_sigma", position_sigma, {1e-6, 100, "m"}, "See `position_share`.");
    v.Field("rotation_sigma", rotation_sigma, {1e-6, 3.15, "rad"},
            "Standard deviation of the rotation between consecutive keyframes.");
  }
};

// Global bundle adjustment (paper, section VI-A).
struct GlobalBundleOptions {
  int rough_iterations = 50;
  int fine_iterations = 40;
  double pixel_sigma = 0.4;
  double revisit_sigma = 1.0;
  double line_sigma = 0.2;
  double huber = 1.5;
  double max_error = 3.5;
  bool use_imu = true;

  template <class V>
  void Visit(V& v) {
    v.Field("rough_iterations", rough_iterations, {1, 10000},
            "Of the first phase, without rejection of outliers.");
    v.Field("fine_iterations", fine_iterations, {1, 10000}, "Of the second phase, with it.");
    v.Field("pixel_sigma", pixel_sigma, {0.01, 100, "px"}, "Standard deviation of an observation.");
    v.Field("revisit_sigma", revisit_sigma, {0.01, 100, "px"},
            "Standard deviation of an observation of a landmark that was seen again after a while: "
            "the detections of two visits show the same point only to a pixel, while a track is "
            "aligned to its first patch.");
    v.Field(
        "line_sigma", line_sigma, {0.01, 100, "px"},
        "Standard deviation of a line's end across the line: as of odometry, whose lines lie on "
        "edges of the image.");
    v.Field("huber", huber, {0.1, 1000, "sigmas"}, "Larger residuals count linearly.");
    v.Field("max_error", max_error, {0.1, 1000, "sigmas"},
            "An observation with a larger error is an outlier.");
    v.Field("use_imu", use_imu,
            "With the inertial factors, where the map has readings and inertial states.");
  }
};

// Everything about refining a map. What each field means stands in Visit.
struct RefineOptions {
  std::string processors = "loop_closure, merge, pose_graph, global_bundle, junction_vocabulary";
  LoopClosureOptions loop_closure;
  MergeOptions merge;
  PoseGraphProcessorOptions pose_graph;
  GlobalBundleOptions global_bundle;

  template <class V>
  void Visit(V& v) {
    v.Field("processors", processors,
            "Which map processors run, in this order, by name, separated by commas.");
    v.Group("loop_closure", loop_closure,
            "Finding places that were visited before (paper, section VI-A).");
    v.Group("merge", merge, "Making one of landmarks that are the same (paper, section VI-A).");
    v.Group("pose_graph", pose_graph,
            "Spreading what loops say over the path (paper, section VI-A).");
    v.Group("global_bundle", global_bundle, "Global bundle adjustment (paper, section VI-A).");
  }
  // Throws Error that names the field; for `processors` also when none is registered by a name.
  void Validate() const;
  // The names in `processors`.
  std::vector<std::string> ProcessorNames() const;
};

}  // namespace airslam
