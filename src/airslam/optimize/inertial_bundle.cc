// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/inertial_bundle.h"

#include <ceres/normal_prior.h>

#include <Eigen/Cholesky>

#include "airslam/common/error.h"
#include "airslam/optimize/kept_factors.h"

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

InertialBundle::InertialBundle(const InertialTerms& terms) : terms_(terms) {
  for (const InertialTerms::Link& link : terms.links) {
    const ImuPreintegration& readings = *link.readings;
    motions_.push_back(std::make_unique<InertialFactor>(readings, terms.body_from_cam));
    walks_.push_back(std::make_unique<BiasWalkFactor>(readings.noise(), readings.duration()));
  }
  if (terms.gravity_sigma > 0) {
    const double weight = 1 / (terms.gravity_sigma * terms.gravity_in_world.norm());
    gravity_prior_ = std::make_unique<ceres::NormalPrior>(weight * Eigen::MatrixXd::Identity(3, 3),
                                                          terms.gravity_in_world);
  }
  for (const InertialTerms::BiasPrior& prior : terms.priors) {
    priors_.push_back(MakeBiasPrior(prior));
  }
}

void InertialBundle::AddTo(KeptFactors& kept) {
  if (terms_.links.empty()) return;
  for (const InertialTerms::State& state : terms_.states) {
    velocities_.push_back(kept.AddUnknown({state.velocity_in_world.data(), 3}, nullptr, false));
    biases_.push_back(kept.AddUnknown(ToParameter(state.bias), nullptr, false));
  }
  gravity_ =
      kept.AddUnknown({terms_.gravity_in_world.data(), 3}, &gravity_manifold_, !gravity_prior_);
  if (gravity_prior_) kept.AddFactor(*gravity_prior_, {gravity_});
  for (std::size_t i = 0; i < terms_.links.size(); ++i) {
    const int from = terms_.links[i].from, to = terms_.links[i].to;
    kept.AddFactor(*motions_[i],
                   {terms_.states[from].pose, velocities_[from], biases_[from],
                    terms_.states[to].pose, velocities_[to], gravity_},
                   {kHuber});
    kept.AddFactor(*walks_[i], {biases_[from], biases_[to]});
  }
  for (std::size_t i = 0; i < terms_.priors.size(); ++i) {
    kept.AddFactor(*priors_[i], {biases_[terms_.priors[i].state]});
  }
}

}  // namespace airslam
