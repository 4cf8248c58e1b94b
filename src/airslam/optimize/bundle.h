// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <vector>

#include "airslam/geometry/pinhole.h"
#include "airslam/geometry/rigid3.h"
#include "airslam/optimize/inertial_bundle.h"
#include "airslam/optimize/line_residual.h"
#include "airslam/optimize/point_residual.h"
#include "airslam/optimize/relative_pose_factor.h"

namespace airslam {

struct BundleOptions {
  int robust_iterations = 6;  // before outliers are rejected
  int final_iterations = 6;   // after
  double huber = 1.5;         // in sigmas
  double max_error = 3.5;     // in sigmas, of the pixel distance: beyond it an outlier
  // Where most residuals are smaller than their sigmas say, the two bounds above shrink with them,
  // of points and of lines each, after the first round: to this share at the least. 1: they do not.
  double least_scale = 1.0;
  // Of the cost: a step that lowers it by less is the last.
  double function_tolerance = 1e-4;
  // The equations of the poses are sparse: for maps, whose keyframes mostly do not see each other.
  bool sparse = false;
  std::function<void(int iteration)> on_iteration = nullptr;
};

// Keyframe poses, points, lines, observations and inertial states by position in these lists;
// solved in place.
struct BundleProblem {
  using Observation = PointSeen;
  using LineSeen = airslam::LineSeen;
  StereoCamera stereo;
  std::vector<Rigid3> world_from_cam;
  std::vector<bool> pose_fixed;  // one a pose; at least one must be
  std::vector<Eigen::Vector3d> points_in_world;
  std::vector<Observation> observations;
  std::vector<PluckerLine> lines_in_world = {};
  std::vector<LineSeen> line_observations = {};
  InertialTerms inertial = {};
  std::vector<RelativePose> relative_poses = {};  // loops
};

struct BundleSummary {
  std::vector<bool> outlier;       // one an observation
  std::vector<bool> line_outlier;  // one a line observation
  int iterations = 0;
  double initial_rms = 0;  // pixels in sigmas, of all observations of points
  double final_rms = 0;    // of the inliers
  double line_rms = 0;     // the same of line ends' distances
};

// Bundle adjustment (paper, section V-E): Levenberg-Marquardt with the Schur complement
// (bundle_solver.h), outliers rejected half-way. A pure function: fixed iteration counts, one
// thread, no time limit. `rms` is per pixel coordinate. An observation of a line is an outlier when
// its ends lie too far from the projected line, or when the stretch that it shows would lie behind
// a camera.
BundleSummary SolveBundle(const BundleOptions& options, BundleProblem* problem);

}  // namespace airslam
