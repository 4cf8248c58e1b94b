// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/inertial_bundle.h"

#include <ceres/normal_prior.h>

#include <Eigen/Cholesky>

#include "airslam/common/error.h"

namespace airslam {
namespace {

std::unique_ptr<ceres::CostFunction> MakeBiasPrior(const InertialTerms::BiasPrior& prior) {
  const Eigen::LLT<Matrix6d> cholesky(prior.covariance);  // covariance = L L'
  if (cholesky.info() != Eigen::Success) Fail("the covariance of biases is not positive definite");
  const Eigen::MatrixXd weight = cholesky.matrixL().solve(Matrix6d::Identity());
  Eigen::VectorXd mean(6);
  mean << prior.mean.gyroscope, prior.mean.accelerometer;
  return std::make_unique<ceres::NormalPrior>(weight, mean);
}

}  // namespace

InertialBundle::InertialBundle(const InertialTerms& terms)
    : terms_(terms), gravity_(terms.gravity_in_world) {
  for (const InertialTerms::State& state : terms.states) {
    velocities_.push_back(state.velocity_in_world);
    biases_.push_back(ToParameter(state.bias));
  }
  for (const InertialTerms::Link& link : terms.links) {
    const ImuPreintegration& readings = *link.readings;
    motions_.push_back(std::make_unique<InertialFactor>(readings, terms.body_from_cam));
    walks_.push_back(std::make_unique<BiasWalkFactor>(readings.noise(), readings.duration()));
  }
  if (terms.gravity_sigma > 0) {
    const double weight = 1 / (terms.gravity_sigma * gravity_.norm());
    gravity_prior_ =
        std::make_unique<ceres::NormalPrior>(weight * Eigen::MatrixXd::Identity(3, 3), gravity_);
  }
  for (const InertialTerms::BiasPrior& prior : terms.priors) {
    priors_.push_back(MakeBiasPrior(prior));
  }
}

void InertialBundle::AddTo(std::vector<PoseParameter>& poses, double weight, int group,
                           ceres::Problem& problem, ceres::ParameterBlockOrdering& ordering) {
  if (terms_.links.empty()) return;
  robust_ = std::make_unique<ceres::ScaledLoss>(new ceres::HuberLoss(kHuber), weight,
                                                ceres::TAKE_OWNERSHIP);
  plain_ = std::make_unique<ceres::ScaledLoss>(nullptr, weight, ceres::TAKE_OWNERSHIP);
  problem.AddParameterBlock(gravity_.data(), 3);
  if (gravity_prior_) {
    problem.SetManifold(gravity_.data(), new GravityManifold);
    problem.AddResidualBlock(gravity_prior_.get(), plain_.get(), gravity_.data());
  } else {
    problem.SetParameterBlockConstant(gravity_.data());
  }
  ordering.AddElementToGroup(gravity_.data(), group + 3);
  for (std::size_t i = 0; i < terms_.links.size(); ++i) {
    const int from = terms_.links[i].from, to = terms_.links[i].to;
    double* pose_from = poses[terms_.states[from].pose].data();
    double* pose_to = poses[terms_.states[to].pose].data();
    problem.AddResidualBlock(motions_[i].get(), robust_.get(), pose_from, velocities_[from].data(),
                             biases_[from].data(), pose_to, velocities_[to].data(),
                             gravity_.data());
    problem.AddResidualBlock(walks_[i].get(), plain_.get(), biases_[from].data(),
                             biases_[to].data());
    for (const int state : {from, to}) {
      ordering.AddElementToGroup(poses[terms_.states[state].pose].data(), group);
      ordering.AddElementToGroup(velocities_[state].data(), group + 1);
      ordering.AddElementToGroup(biases_[state].data(), group + 2);
    }
  }
  for (std::size_t i = 0; i < terms_.priors.size(); ++i) {
    double* bias = biases_[terms_.priors[i].state].data();
    problem.AddResidualBlock(priors_[i].get(), plain_.get(), bias);
    ordering.AddElementToGroup(bias, group + 2);
  }
}

void InertialBundle::CopyTo(InertialTerms& terms) const {
  terms.gravity_in_world = gravity_;
  for (std::size_t i = 0; i < terms.states.size(); ++i) {
    terms.states[i].velocity_in_world = velocities_[i];
    terms.states[i].bias = FromParameter(biases_[i]);
  }
}

}  // namespace airslam
