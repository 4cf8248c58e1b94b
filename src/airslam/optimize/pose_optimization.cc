// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/pose_optimization.h"

#include <ceres/loss_function.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

#include <cmath>
#include <memory>

#include "airslam/optimize/pose_parameter.h"

namespace airslam {
namespace {

constexpr int kMinConstraints = 4;

using Factors = std::vector<std::unique_ptr<FixedPointFactor>>;

void SolveRound(const Factors& factors, const std::vector<bool>& inlier,
                PosePriorFactor* prior, bool robust, const PoseOptimizationOptions& options,
                PoseParameter& pose) {
  ceres::Problem::Options ownership;
  ownership.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ownership.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem problem(ownership);
  ceres::HuberLoss huber(options.huber);
  problem.AddParameterBlock(pose.data(), 7, new PoseManifold);
  if (prior != nullptr) problem.AddResidualBlock(prior, nullptr, pose.data());
  for (std::size_t i = 0; i < factors.size(); ++i) {
    if (!inlier[i]) continue;
    problem.AddResidualBlock(factors[i].get(), robust ? &huber : nullptr, pose.data());
  }
  ceres::Solver::Options solver;
  solver.linear_solver_type = ceres::DENSE_QR;
  solver.max_num_iterations = options.iterations_per_round;
  solver.num_threads = 1;
  solver.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &problem, &summary);
}

// Root of the mean squared residual per image axis pair, so that a stereo observation is judged by
// the same bound as one of the left image only.
double PixelError(const FixedPointFactor& factor, const PoseParameter& pose) {
  double residuals[3];
  const double* blocks[] = {pose.data()};
  factor.Evaluate(blocks, residuals, nullptr);
  double squares = 0;
  for (int i = 0; i < factor.num_residuals(); ++i) squares += residuals[i] * residuals[i];
  return std::sqrt(squares * 2 / factor.num_residuals());
}

}  // namespace

PoseOptimizationResult OptimizePose(const StereoCamera& stereo,
                                    const std::vector<PointConstraint>& constraints,
                                    const Rigid3& initial_world_from_cam,
                                    const std::optional<PosePrior>& prior,
                                    const PoseOptimizationOptions& options) {
  PoseOptimizationResult result;
  result.world_from_cam = initial_world_from_cam;
  result.inlier.assign(constraints.size(), false);
  if (constraints.size() < kMinConstraints) return result;

  Factors factors;
  factors.reserve(constraints.size());
  for (const PointConstraint& c : constraints) {
    factors.push_back(
        std::make_unique<FixedPointFactor>(stereo, c.observation, c.point_in_world));
  }
  const auto prior_factor = prior ? std::make_unique<PosePriorFactor>(*prior) : nullptr;
  result.inlier.assign(constraints.size(), true);
  result.inliers = static_cast<int>(constraints.size());
  PoseParameter pose = ToParameter(initial_world_from_cam);
  double squares = 0;
  for (int round = 0; round < options.rounds && result.inliers >= kMinConstraints; ++round) {
    SolveRound(factors, result.inlier, prior_factor.get(), round + 1 < options.rounds, options,
               pose);
    result.inliers = 0;
    squares = 0;
    for (std::size_t i = 0; i < factors.size(); ++i) {
      const double error = PixelError(*factors[i], pose);
      result.inlier[i] = error <= options.max_error;
      if (!result.inlier[i]) continue;
      ++result.inliers;
      squares += error * error;
    }
  }
  result.world_from_cam = FromParameter(pose);
  result.rms = result.inliers > 0 ? std::sqrt(squares / result.inliers) : 0;
  return result;
}

}  // namespace airslam
