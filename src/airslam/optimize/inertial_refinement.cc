// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/inertial_refinement.h"

#include <ceres/crs_matrix.h>
#include <ceres/normal_prior.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <algorithm>
#include <cmath>
#include <limits>

#include "airslam/optimize/inertial_factor.h"
#include "airslam/optimize/pose_parameter.h"
#include "airslam/optimize/pose_prior_factor.h"
#include "airslam/optimize/worst_sigma.h"

namespace airslam {
namespace {

using Eigen::Vector3d;

// The parameter blocks that Ceres moves; velocities and gravity lie in the estimate itself.
struct Parameters {
  std::vector<PoseParameter> poses;
  BiasParameter bias;
};

void AddFactors(const InertialInitializationOptions& options,
                const std::vector<InertialFrame>& frames,
                const std::vector<ImuPreintegration>& between, const Rigid3& body_from_cam,
                InertialInitialization& estimate, Parameters& parameters, ceres::Problem& problem) {
  double* gravity = estimate.gravity_in_world.data();
  for (std::size_t i = 0; i < frames.size(); ++i) {
    double* pose = parameters.poses[i].data();
    const PosePrior prior{frames[i].world_from_cam, options.sigma_rotation, options.sigma_position};
    problem.AddResidualBlock(new PosePriorFactor(prior), nullptr, pose);
    problem.SetManifold(pose, new PoseManifold);
  }
  for (std::size_t i = 0; i < between.size(); ++i) {
    problem.AddResidualBlock(new InertialFactor(between[i], body_from_cam), nullptr,
                             parameters.poses[i].data(), estimate.velocities_in_world[i].data(),
                             parameters.bias.data(), parameters.poses[i + 1].data(),
                             estimate.velocities_in_world[i + 1].data(), gravity);
  }
  problem.SetManifold(gravity, new GravityManifold);
  Eigen::MatrixXd prior = Eigen::MatrixXd::Zero(3, 6);
  prior.rightCols<3>() = Eigen::Matrix3d::Identity() / options.sigma_accelerometer_bias;
  problem.AddResidualBlock(new ceres::NormalPrior(prior, Eigen::VectorXd::Zero(6)), nullptr,
                           parameters.bias.data());
}

double Solve(ceres::Problem& problem) {
  ceres::Solver::Options solver;
  solver.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  solver.sparse_linear_algebra_library_type = ceres::EIGEN_SPARSE;
  solver.max_num_iterations = 10;
  solver.num_threads = 1;
  solver.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &problem, &summary);
  return summary.final_cost;
}

// Covariance of biases (6) and gravity (2): the corner of the inverse of J'J, not finite where
// nothing is known of some direction. (ceres::Covariance orders its blocks by address, so that its
// last digits change from run to run.)
Eigen::MatrixXd Covariance(InertialInitialization& estimate, Parameters& parameters,
                           ceres::Problem& problem) {
  ceres::Problem::EvaluateOptions options;
  for (PoseParameter& pose : parameters.poses) options.parameter_blocks.push_back(pose.data());
  for (Vector3d& velocity : estimate.velocities_in_world) {
    options.parameter_blocks.push_back(velocity.data());
  }
  options.parameter_blocks.push_back(parameters.bias.data());
  options.parameter_blocks.push_back(estimate.gravity_in_world.data());
  options.num_threads = 1;
  ceres::CRSMatrix crs;
  problem.Evaluate(options, nullptr, nullptr, nullptr, &crs);
  const Eigen::SparseMatrix<double, Eigen::RowMajor> jacobian =
      Eigen::Map<const Eigen::SparseMatrix<double, Eigen::RowMajor>>(
          crs.num_rows, crs.num_cols, static_cast<Eigen::Index>(crs.values.size()), crs.rows.data(),
          crs.cols.data(), crs.values.data());
  const Eigen::SparseMatrix<double> information = jacobian.transpose() * jacobian;
  const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> factors(information);
  Eigen::MatrixXd corner = Eigen::MatrixXd::Zero(crs.num_cols, 8);
  corner.bottomRows<8>().setIdentity();
  if (factors.info() != Eigen::Success) return Eigen::MatrixXd::Constant(8, 8, std::nan(""));
  return factors.solve(corner).bottomRows<8>();
}

// By how much a unit step in Ceres' tangent space turns gravity (rad): read off the manifold.
double TurnOfAStep(const Vector3d& gravity) {
  Vector3d moved;
  const double step[2] = {1e-6, 0};
  GravityManifold().Plus(gravity.data(), step, moved.data());
  return moved.cross(gravity).norm() / (1e-6 * gravity.squaredNorm());
}

void SetSigmas(const Eigen::MatrixXd& covariance, InertialInitialization& estimate) {
  if (!covariance.allFinite()) {
    estimate.gyroscope_bias_sigma = estimate.accelerometer_bias_sigma = estimate.gravity_sigma =
        std::numeric_limits<double>::infinity();
    return;
  }
  estimate.gyroscope_bias_sigma = WorstSigma<3>(covariance.block<3, 3>(0, 0));
  estimate.accelerometer_bias_sigma = WorstSigma<3>(covariance.block<3, 3>(3, 3));
  estimate.gravity_sigma =
      TurnOfAStep(estimate.gravity_in_world) * WorstSigma<2>(covariance.block<2, 2>(6, 6));
}

}  // namespace

void RefineInertial(const InertialInitializationOptions& options,
                    const std::vector<InertialFrame>& frames,
                    const std::vector<ImuPreintegration>& between, const Rigid3& body_from_cam,
                    InertialInitialization& estimate) {
  Parameters parameters;
  for (const InertialFrame& frame : frames) {
    parameters.poses.push_back(ToParameter(frame.world_from_cam));
  }
  parameters.bias = ToParameter(estimate.bias);
  ceres::Problem problem;
  AddFactors(options, frames, between, body_from_cam, estimate, parameters, problem);
  const double cost = Solve(problem);
  estimate.bias = FromParameter(parameters.bias);
  // Less poses, velocities, biases and gravity.
  const int unknowns = 9 * static_cast<int>(frames.size()) + 6 + 2;
  estimate.residual = std::sqrt(2 * cost / std::max(1, problem.NumResiduals() - unknowns));
  SetSigmas(Covariance(estimate, parameters, problem), estimate);
}

}  // namespace airslam
