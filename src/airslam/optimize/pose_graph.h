// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <vector>

#include "airslam/optimize/relative_pose_factor.h"

namespace airslam {

struct PoseGraphOptions {
  int iterations = 50;
  // Beyond so many sigmas an edge counts less and less: one wrong loop must not bend the map. (95 %
  // of the six coordinates' norms lie within 3.5.)
  double huber = 3.5;
  std::function<void(int iteration)> on_iteration = nullptr;
};

// Poses (world_from_cam) by position in the list; solved in place.
struct PoseGraphProblem {
  std::vector<Rigid3> poses;
  std::vector<bool> fixed;  // one a pose; each connected part needs one
  std::vector<RelativePose> edges;
};

struct PoseGraphSummary {
  int iterations = 0;
  double initial_rms = 0, final_rms = 0;  // of an edge's coordinate, in sigmas
};

// Pose graph optimization (paper, section VI-A): Levenberg-Marquardt, sparse Cholesky. A pure
// function: fixed iteration count, one thread.
PoseGraphSummary SolvePoseGraph(const PoseGraphOptions& options, PoseGraphProblem* problem);

}  // namespace airslam
