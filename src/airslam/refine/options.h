// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

namespace airslam {

// Finding places that were visited before (paper, section VI-A).
struct LoopClosureOptions {
  // Of the best score of earlier keyframes: below it no candidate, in [0, 1).
  double min_score_share = 0.3;
  // Keyframes that share more landmarks than this form a group, >= 0; of the best groups, at most
  // so many, one keyframe each is matched, >= 1.
  int min_shared_in_group = 10;
  int max_groups = 3;
  // A loop has more inliers than this, >= 6.
  int min_inliers = 50;
  // Standard deviation of a keypoint in pixels, > 0, and what RANSAC takes for an inlier, > 0.
  double pixel_sigma = 1.0;
  double ransac_error = 4.0;
  // The pose is found a second time from the other keyframe's points. Both must agree within this
  // share of the points' median depth, > 0, and this angle (rad), > 0.
  double max_disagreement = 0.03;
  double max_disagreement_angle = 0.02;
  // A loop that would move a keyframe by more than this share of the path since the other one (and
  // half a metre), > 0, or turn it by more (rad), > 0, is not believed: odometry does not drift so
  // much, but places look alike.
  double max_drift = 0.05;
  double max_drift_angle = 0.2;
  // Two components become one when so many loops between them agree, >= 1.
  int min_joining_loops = 3;

  template <class V>
  void Visit(V& v) {
    v.Field("min_score_share", min_score_share);
    v.Field("min_shared_in_group", min_shared_in_group);
    v.Field("max_groups", max_groups);
    v.Field("min_inliers", min_inliers);
    v.Field("pixel_sigma", pixel_sigma);
    v.Field("ransac_error", ransac_error);
    v.Field("max_disagreement", max_disagreement);
    v.Field("max_disagreement_angle", max_disagreement_angle);
    v.Field("max_drift", max_drift);
    v.Field("max_drift_angle", max_drift_angle);
    v.Field("min_joining_loops", min_joining_loops);
  }
  // Throws Error that names the field.
  void Validate() const;
};

// Making one of landmarks that are the same (paper, section VI-A).
struct MergeOptions {
  // Lines that share more points than this are one, >= 1.
  int min_shared_points = 3;

  template <class V>
  void Visit(V& v) {
    v.Field("min_shared_points", min_shared_points);
  }
  void Validate() const;
};

// Pose graph (paper, section VI-A): spreads what loops say over the path.
struct PoseGraphProcessorOptions {
  int iterations = 50;  // >= 1
  // Maps with fewer landmarks go straight to bundle adjustment, >= 0. (The paper: 80,000, since its
  // bundle adjustment copes with the drift of smaller maps. A pose graph takes milliseconds, and
  // with it bundle adjustment starts near its end.)
  int min_landmarks = 0;
  // Standard deviation of the motion between consecutive keyframes: of its position, this share of
  // its length and this many metres; of its rotation, rad. All > 0.
  double position_share = 0.005;
  double position_sigma = 0.002;
  double rotation_sigma = 0.001;

  template <class V>
  void Visit(V& v) {
    v.Field("iterations", iterations);
    v.Field("min_landmarks", min_landmarks);
    v.Field("position_share", position_share);
    v.Field("position_sigma", position_sigma);
    v.Field("rotation_sigma", rotation_sigma);
  }
  void Validate() const;
};

// Global bundle adjustment (paper, section VI-A).
struct GlobalBundleOptions {
  int rough_iterations = 50;  // without rejection of outliers, >= 1
  int fine_iterations = 40;   // after it, >= 1
  double pixel_sigma = 0.4;   // standard deviation of an observation in pixels, > 0
  // The same of a landmark that was seen again after a while, > 0: the detections of two visits
  // show the same point only to a pixel, while a track is aligned to its first patch.
  double revisit_sigma = 1.0;
  double line_sigma = 1.0;  // of a line\'s end across it in pixels, > 0
  double huber = 1.5;       // in sigmas, > 0
  double max_error = 3.5;   // in sigmas: beyond it an outlier, > 0
  bool use_imu = true;      // where the map has readings and inertial states

  template <class V>
  void Visit(V& v) {
    v.Field("rough_iterations", rough_iterations);
    v.Field("fine_iterations", fine_iterations);
    v.Field("pixel_sigma", pixel_sigma);
    v.Field("revisit_sigma", revisit_sigma);
    v.Field("line_sigma", line_sigma);
    v.Field("huber", huber);
    v.Field("max_error", max_error);
    v.Field("use_imu", use_imu);
  }
  void Validate() const;
};

// Everything about refining a map.
struct RefineOptions {
  // Which map processors run, in this order, by name, separated by commas.
  std::string processors = "loop_closure, merge, pose_graph, global_bundle, junction_vocabulary";
  LoopClosureOptions loop_closure;
  MergeOptions merge;
  PoseGraphProcessorOptions pose_graph;
  GlobalBundleOptions global_bundle;

  template <class V>
  void Visit(V& v) {
    v.Field("processors", processors);
    v.Group("loop_closure", loop_closure);
    v.Group("merge", merge);
    v.Group("pose_graph", pose_graph);
    v.Group("global_bundle", global_bundle);
  }
  // Throws Error that names the field; for `processors` also when none is registered by a name.
  void Validate() const;
  // The names in `processors`.
  std::vector<std::string> ProcessorNames() const;
};

}  // namespace airslam
