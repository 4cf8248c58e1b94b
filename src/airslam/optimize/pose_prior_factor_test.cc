// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/pose_prior_factor.h"

#include <ceres/gradient_checker.h>
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>

#include "airslam/common/error.h"
#include "airslam/geometry/so3.h"
#include "airslam/optimize/pose_parameter.h"

namespace airslam {
namespace {

const Rigid3 kPrior{Eigen::Quaterniond(0.8, 0.3, -0.4, 0.33), {1.0, -2.0, 0.5}};

TEST(PosePriorFactor, MeasuresRotationAndPositionInSigmas) {
  const Eigen::Vector3d turn(0.02, -0.01, 0.03), shift(0.1, 0.2, -0.3);
  Rigid3 pose = kPrior;
  pose.rotation = pose.rotation * ExpSO3(turn);
  pose.translation += shift;
  PoseParameter parameter = ToParameter(pose);
  for (int side = 0; side < 2; ++side) {  // q and -q
    const double* blocks[] = {parameter.data()};
    Eigen::Matrix<double, 6, 1> residuals;
    PosePriorFactor({kPrior, 0.1, 0.5}).Evaluate(blocks, residuals.data(), nullptr);
    EXPECT_LT((residuals.head<3>() - turn / 0.1).norm(), 1e-3);
    EXPECT_LT((residuals.tail<3>() - shift / 0.5).norm(), 1e-12);
    for (int i = 0; i < 4; ++i) parameter[i] = -parameter[i];
  }
}

// Rotation and position hang together, as in a prediction by the IMU.
Matrix6d CorrelatedCovariance() {
  Matrix6d root = Matrix6d::Identity() * 0.2;
  root(0, 0) = 0.05;
  root(4, 0) = 0.3;
  root(5, 1) = -0.1;
  return root * root.transpose();
}

TEST(PosePriorFactor, WeighsByTheWholeCovariance) {
  const Matrix6d covariance = CorrelatedCovariance();
  Eigen::Matrix<double, 6, 1> error;
  error << 0.001, -0.002, 0.001, 0.2, -0.1, 0.3;
  Rigid3 pose = kPrior;
  pose.rotation = pose.rotation * ExpSO3(error.head<3>());
  pose.translation += error.tail<3>();
  const PoseParameter parameter = ToParameter(pose);
  const double* blocks[] = {parameter.data()};
  Eigen::Matrix<double, 6, 1> residuals;
  const PosePrior prior = PosePrior::FromCovariance(kPrior, covariance);
  PosePriorFactor(prior).Evaluate(blocks, residuals.data(), nullptr);
  EXPECT_NEAR(residuals.squaredNorm(), error.dot(covariance.inverse() * error), 1e-6);
  EXPECT_NEAR(prior.SigmaPosition(),
              std::sqrt(covariance.bottomRightCorner<3, 3>().eigenvalues().real().maxCoeff()),
              1e-9);
  EXPECT_THROW(PosePrior::FromCovariance(kPrior, -covariance), Error);
}

TEST(PosePriorFactor, Jacobian) {
  const PosePriorFactor factor(PosePrior::FromCovariance(kPrior, CorrelatedCovariance()));
  const PoseManifold manifold;
  const std::vector<const ceres::Manifold*> manifolds = {&manifold};
  const PoseParameter pose =
      ToParameter(kPrior * Rigid3(ExpSO3({0.3, -0.2, 0.1}), Eigen::Vector3d(0.1, 0.2, 0.3)));
  const double* blocks[] = {pose.data()};
  const ceres::GradientChecker checker(&factor, &manifolds, ceres::NumericDiffOptions());
  ceres::GradientChecker::ProbeResults results;
  EXPECT_TRUE(checker.Probe(blocks, 1e-6, &results)) << results.error_log;
}

}  // namespace
}  // namespace airslam
