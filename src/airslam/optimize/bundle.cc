// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/bundle.h"

#include <ceres/loss_function.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "airslam/optimize/pose_parameter.h"

namespace airslam {
namespace {

using Factors = std::vector<std::unique_ptr<PointFactor>>;

// The parameter blocks that Ceres moves.
struct Parameters {
  std::vector<PoseParameter> poses;
  std::vector<Eigen::Vector3d> points;
};

// What one round of solving takes besides the problem.
struct Round {
  const std::vector<bool>& outlier;
  double huber;
  int iterations;
  double visual_variance;  // of a pixel coordinate, in squares of its assumed sigma
};

int SolveRound(const BundleProblem& bundle, const Factors& factors, const Round& round,
               Parameters& parameters, InertialBundle& inertial) {
  ceres::Problem::Options ownership;
  ownership.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ownership.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem problem(ownership);
  ceres::HuberLoss loss(round.huber);
  ceres::Solver::Options solver;
  solver.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (std::size_t i = 0; i < factors.size(); ++i) {
    if (round.outlier[i]) continue;
    const BundleProblem::Observation& o = bundle.observations[i];
    problem.AddResidualBlock(factors[i].get(), &loss, parameters.poses[o.pose].data(),
                             parameters.points[o.point].data());
    solver.linear_solver_ordering->AddElementToGroup(parameters.points[o.point].data(), 0);
    solver.linear_solver_ordering->AddElementToGroup(parameters.poses[o.pose].data(), 1);
  }
  inertial.AddTo(parameters.poses, round.visual_variance, 1, problem, *solver.linear_solver_ordering);
  for (std::size_t i = 0; i < parameters.poses.size(); ++i) {
    double* pose = parameters.poses[i].data();
    if (!problem.HasParameterBlock(pose)) continue;
    problem.SetManifold(pose, new PoseManifold);
    if (bundle.pose_fixed[i]) problem.SetParameterBlockConstant(pose);
  }
  solver.linear_solver_type = ceres::DENSE_SCHUR;
  solver.max_num_iterations = round.iterations;
  solver.function_tolerance = 1e-4;  // of the cost: further steps move nothing that matters
  solver.num_threads = 1;
  solver.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &problem, &summary);
  return static_cast<int>(summary.iterations.size());
}

// Squared residual of one observation, summed over its 2 or 3 coordinates.
double SquaredError(const PointFactor& factor, const BundleProblem::Observation& o,
                    const Parameters& parameters) {
  double residuals[3];
  const double* blocks[] = {parameters.poses[o.pose].data(), parameters.points[o.point].data()};
  factor.Evaluate(blocks, residuals, nullptr);
  double squares = 0;
  for (int i = 0; i < factor.num_residuals(); ++i) squares += residuals[i] * residuals[i];
  return squares;
}

// Marks outliers (when max_error is not zero) and returns the rms per coordinate of the others.
double Judge(const BundleProblem& bundle, const Factors& factors, const Parameters& parameters,
             double max_error, std::vector<bool>& outlier) {
  double squares = 0;
  int coordinates = 0;
  for (std::size_t i = 0; i < factors.size(); ++i) {
    const double error = SquaredError(*factors[i], bundle.observations[i], parameters);
    const int rows = factors[i]->num_residuals();
    if (max_error > 0) outlier[i] = error * 2 / rows > max_error * max_error;
    if (outlier[i]) continue;
    squares += error;
    coordinates += rows;
  }
  return coordinates > 0 ? std::sqrt(squares / coordinates) : 0;
}

// The variance of a pixel coordinate as the residuals show it, in squares of its assumed sigma: what
// the IMU is weighed against. At most 1.
double VisualVariance(const BundleProblem& bundle, const std::vector<bool>& outlier, double rms) {
  int coordinates = 0;
  for (std::size_t i = 0; i < outlier.size(); ++i) {
    if (!outlier[i]) coordinates += bundle.observations[i].seen.has_right() ? 3 : 2;
  }
  const auto unknowns = static_cast<double>(3 * bundle.points_in_world.size() +
                                            6 * bundle.world_from_cam.size());
  const double freedom = std::max(coordinates - unknowns, 0.1 * coordinates);
  return coordinates > 0 ? std::clamp(rms * rms * coordinates / freedom, 0.01, 1.0) : 1.0;
}

}  // namespace

BundleSummary SolveBundle(const BundleOptions& options, BundleProblem* problem) {
  Parameters parameters;
  for (const Rigid3& pose : problem->world_from_cam) parameters.poses.push_back(ToParameter(pose));
  parameters.points = problem->points_in_world;
  Factors factors;
  factors.reserve(problem->observations.size());
  for (const BundleProblem::Observation& o : problem->observations) {
    factors.push_back(std::make_unique<PointFactor>(problem->stereo, o.seen));
  }
  BundleSummary summary;
  summary.outlier.assign(factors.size(), false);
  summary.initial_rms = Judge(*problem, factors, parameters, 0, summary.outlier);
  InertialBundle inertial(problem->inertial);
  double variance = VisualVariance(*problem, summary.outlier, summary.initial_rms);
  summary.iterations = SolveRound(
      *problem, factors, {summary.outlier, options.huber, options.robust_iterations, variance},
      parameters, inertial);
  const double rms = Judge(*problem, factors, parameters, options.max_error, summary.outlier);
  variance = VisualVariance(*problem, summary.outlier, rms);
  summary.iterations += SolveRound(
      *problem, factors, {summary.outlier, options.huber, options.final_iterations, variance},
      parameters, inertial);
  summary.final_rms =
      Judge(*problem, factors, parameters, options.max_error, summary.outlier);
  for (std::size_t i = 0; i < parameters.poses.size(); ++i) {
    if (!problem->pose_fixed[i]) problem->world_from_cam[i] = FromParameter(parameters.poses[i]);
  }
  problem->points_in_world = parameters.points;
  inertial.CopyTo(problem->inertial);
  return summary;
}

}  // namespace airslam
