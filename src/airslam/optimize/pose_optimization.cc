// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/pose_optimization.h"

#include <ceres/loss_function.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

#include <cmath>
#include <memory>

#include "airslam/geometry/so3.h"
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

Matrix6d PoseInformation(const StereoCamera& stereo,
                         const std::vector<PointConstraint>& constraints,
                         const Rigid3& world_from_cam) {
  const Pinhole& camera = stereo.camera;
  const Rigid3 cam_from_world = world_from_cam.Inverse();
  Eigen::Matrix<double, 3, 6> point_by_pose;
  point_by_pose.rightCols<3>() = -cam_from_world.rotation.toRotationMatrix();
  Matrix6d information = Matrix6d::Zero();
  for (const PointConstraint& c : constraints) {
    const Eigen::Vector3d p = cam_from_world * c.point_in_world;
    if (p.z() <= 0) continue;
    point_by_pose.leftCols<3>() = Skew(p);
    const double x = camera.fx / p.z(), y = camera.fy / p.z();
    Eigen::Matrix3d pixel_by_point;
    pixel_by_point << x, 0, -x * p.x() / p.z(), 0, y, -y * p.y() / p.z(), x, 0,
        -x * (p.x() - stereo.baseline) / p.z();
    if (!c.observation.has_right()) pixel_by_point.row(2).setZero();
    const Eigen::Matrix<double, 3, 6> by_pose =
        pixel_by_point * point_by_pose / c.observation.sigma;
    information += by_pose.transpose() * by_pose;
  }
  return information;
}

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
