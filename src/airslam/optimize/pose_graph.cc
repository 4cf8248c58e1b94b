// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/pose_graph.h"

#include <ceres/loss_function.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

#include <cmath>
#include <memory>

#include "airslam/optimize/iteration_callback.h"
#include "airslam/optimize/pose_parameter.h"

namespace airslam {
namespace {

using Factors = std::vector<std::unique_ptr<RelativePoseFactor>>;

double Rms(const PoseGraphProblem& graph, const Factors& factors,
           const std::vector<PoseParameter>& poses) {
  double squares = 0;
  for (std::size_t i = 0; i < factors.size(); ++i) {
    const double* blocks[] = {poses[graph.edges[i].from].data(), poses[graph.edges[i].to].data()};
    Eigen::Matrix<double, 6, 1> residual;
    factors[i]->Evaluate(blocks, residual.data(), nullptr);
    squares += residual.squaredNorm();
  }
  return factors.empty() ? 0 : std::sqrt(squares / (6.0 * static_cast<double>(factors.size())));
}

}  // namespace

PoseGraphSummary SolvePoseGraph(const PoseGraphOptions& options, PoseGraphProblem* problem) {
  std::vector<PoseParameter> poses;
  for (const Rigid3& pose : problem->poses) poses.push_back(ToParameter(pose));
  Factors factors;
  for (const RelativePose& edge : problem->edges) {
    factors.push_back(std::make_unique<RelativePoseFactor>(edge));
  }
  PoseGraphSummary summary;
  summary.initial_rms = Rms(*problem, factors, poses);

  ceres::Problem::Options ownership;
  ownership.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ownership.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem graph(ownership);
  ceres::HuberLoss loss(options.huber);
  for (std::size_t i = 0; i < factors.size(); ++i) {
    graph.AddResidualBlock(factors[i].get(), &loss, poses[problem->edges[i].from].data(),
                           poses[problem->edges[i].to].data());
  }
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (!graph.HasParameterBlock(poses[i].data())) continue;
    graph.SetManifold(poses[i].data(), new PoseManifold);
    if (problem->fixed[i]) graph.SetParameterBlockConstant(poses[i].data());
  }
  ceres::Solver::Options solver;
  solver.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  solver.max_num_iterations = options.iterations;
  solver.function_tolerance = 1e-8;
  solver.num_threads = 1;
  solver.logging_type = ceres::SILENT;
  IterationReporter reporter(options.on_iteration, 0);
  solver.callbacks.push_back(&reporter);
  ceres::Solver::Summary solved;
  if (graph.NumResidualBlocks() > 0) ceres::Solve(solver, &graph, &solved);
  summary.iterations = static_cast<int>(solved.iterations.size());
  summary.final_rms = Rms(*problem, factors, poses);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (!problem->fixed[i]) problem->poses[i] = FromParameter(poses[i]);
  }
  return summary;
}

}  // namespace airslam
