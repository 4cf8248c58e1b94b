// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/inertial_factor.h"

#include <ceres/gradient_checker.h>
#include <ceres/problem.h>
#include <ceres/solver.h>
#include <gtest/gtest.h>

#include <cmath>

#include "airslam/common/error.h"
#include "airslam/geometry/so3.h"
#include "airslam/optimize/pose_parameter.h"
#include "airslam/sensor/imu_buffer.h"
#include "airslam/testing/synthetic_motion.h"

namespace airslam {
namespace {

constexpr std::int64_t kStart = 1'700'000'000'000'000'000;
const Rigid3 kBodyFromCam{Eigen::Quaterniond(0.7, -0.1, 0.2, 0.68), {0.06, -0.02, 0.1}};
const ImuNoise kNoise{2e-4, 2e-5, 2e-3, 3e-3, 200};
const ImuBias kBias{{0.01, -0.02, 0.03}, {0.1, 0.2, -0.1}};

// Two states of the synthetic motion and what an exact IMU reads between them.
class InertialFactorTest : public ::testing::Test {
 protected:
  InertialFactorTest() {
    ImuSimulationOptions options;
    options.noise.rate_hz = 200;
    options.gyroscope_bias = kBias.gyroscope;
    options.accelerometer_bias = kBias.accelerometer;
    const std::int64_t end = kStart + 500'000'000;
    const ImuBuffer buffer(SimulateImu(motion_, kStart, end + 1'000'000, options).samples, {});
    // Linearised away from the true bias.
    const ImuBias near{kBias.gyroscope + Eigen::Vector3d(1e-3, 2e-3, -1e-3),
                       kBias.accelerometer + Eigen::Vector3d(0.02, -0.01, 0.03)};
    preintegration_ = ImuPreintegration(buffer.Between(kStart, end).samples, kNoise, near);
    const BodyState i = motion_.At(kStart), j = motion_.At(end);
    pose_i_ = ToParameter(i.world_from_body * kBodyFromCam);
    pose_j_ = ToParameter(j.world_from_body * kBodyFromCam);
    velocity_i_ = i.velocity_in_world;
    velocity_j_ = j.velocity_in_world;
  }

  std::vector<double*> Blocks() {
    return {pose_i_.data(), velocity_i_.data(), bias_.data(),
            pose_j_.data(), velocity_j_.data(), gravity_.data()};
  }

  SyntheticTrajectory motion_ =
      SyntheticTrajectory::Loop(10, 3).Mount(Eigen::Quaterniond(0.5, 0.5, -0.5, 0.5), kStart);
  ImuPreintegration preintegration_;
  PoseParameter pose_i_, pose_j_;
  Eigen::Vector3d velocity_i_, velocity_j_, gravity_ = kGravityInWorld;
  BiasParameter bias_ = ToParameter(kBias);
};

TEST_F(InertialFactorTest, VanishesAtTheTruth) {
  const InertialFactor factor(preintegration_, kBodyFromCam);
  Eigen::Matrix<double, 9, 1> residuals;
  ASSERT_TRUE(factor.Evaluate(Blocks().data(), residuals.data(), nullptr));
  EXPECT_LT(residuals.norm(), 0.3) << residuals.transpose();
  velocity_j_ += Eigen::Vector3d(0.05, 0.05, 0.05);
  ASSERT_TRUE(factor.Evaluate(Blocks().data(), residuals.data(), nullptr));
  EXPECT_GT(residuals.norm(), 20);
}

TEST_F(InertialFactorTest, IsWhitened) {
  // r' r is the error's Mahalanobis distance.
  Eigen::Matrix<double, 9, 1> residuals;
  const InertialFactor factor(preintegration_, kBodyFromCam);
  ASSERT_TRUE(factor.Evaluate(Blocks().data(), residuals.data(), nullptr));
  const Eigen::Matrix<double, 9, 1> before = residuals;
  const Eigen::Vector3d push(0.01, -0.02, 0.03);
  velocity_j_ += push;
  ASSERT_TRUE(factor.Evaluate(Blocks().data(), residuals.data(), nullptr));
  Eigen::Matrix<double, 9, 1> error = Eigen::Matrix<double, 9, 1>::Zero();
  error.segment<3>(3) = motion_.At(kStart).world_from_body.rotation.conjugate() * push;
  const double distance = error.dot(preintegration_.covariance().ldlt().solve(error));
  EXPECT_NEAR((residuals - before).squaredNorm() / distance, 1, 1e-3);
}

TEST_F(InertialFactorTest, Jacobians) {
  const PoseManifold pose_manifold;
  const GravityManifold gravity_manifold;
  const std::vector<const ceres::Manifold*> manifolds = {
      &pose_manifold, nullptr, nullptr, &pose_manifold, nullptr, &gravity_manifold};
  // Away from the truth, where no term vanishes.
  const auto disturb = [](PoseParameter& pose, const Eigen::Vector3d& turn) {
    pose = ToParameter(FromParameter(pose) * Rigid3(ExpSO3(turn), 0.3 * turn));
  };
  disturb(pose_i_, {0.2, -0.3, 0.1});
  disturb(pose_j_, {-0.3, 0.2, 0.4});
  velocity_i_ += Eigen::Vector3d(0.3, 0.1, -0.2);
  bias_ = {0.03, -0.05, 0.02, 0.3, -0.2, 0.1};
  gravity_ = ExpSO3({0.3, 0.2, 0}) * kGravityInWorld;
  const InertialFactor factor(preintegration_, kBodyFromCam);
  const ceres::GradientChecker checker(&factor, &manifolds, ceres::NumericDiffOptions());
  ceres::GradientChecker::ProbeResults results;
  EXPECT_TRUE(checker.Probe(Blocks().data(), 1e-6, &results)) << results.error_log;
}

TEST_F(InertialFactorTest, JacobiansAtTheTruth) {
  const PoseManifold pose_manifold;
  const GravityManifold gravity_manifold;
  const std::vector<const ceres::Manifold*> manifolds = {
      &pose_manifold, nullptr, nullptr, &pose_manifold, nullptr, &gravity_manifold};
  const InertialFactor factor(preintegration_, kBodyFromCam);
  const ceres::GradientChecker checker(&factor, &manifolds, ceres::NumericDiffOptions());
  ceres::GradientChecker::ProbeResults results;
  EXPECT_TRUE(checker.Probe(Blocks().data(), 1e-6, &results)) << results.error_log;
}

TEST_F(InertialFactorTest, LeadsTheSecondStateToTheTruth) {
  const PoseParameter true_pose = pose_j_;
  const Eigen::Vector3d true_velocity = velocity_j_;
  pose_j_ = pose_i_;
  velocity_j_.setZero();
  ceres::Problem problem;
  problem.AddResidualBlock(new InertialFactor(preintegration_, kBodyFromCam), nullptr, Blocks());
  problem.SetManifold(pose_j_.data(), new PoseManifold);
  for (double* block : {pose_i_.data(), velocity_i_.data(), bias_.data(), gravity_.data()}) {
    problem.SetParameterBlockConstant(block);
  }
  ceres::Solver::Options options;
  options.num_threads = 1;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  const Rigid3 error = FromParameter(true_pose).Inverse() * FromParameter(pose_j_);
  EXPECT_LT(error.Angle(), 1e-4);
  EXPECT_LT(error.translation.norm(), 1e-3);
  EXPECT_LT((velocity_j_ - true_velocity).norm(), 1e-3);
}

TEST_F(InertialFactorTest, NeedsTime) {
  EXPECT_THROW(InertialFactor(ImuPreintegration(), kBodyFromCam), Error);
}

TEST_F(InertialFactorTest, StaysFiniteWithoutNoise) {
  const InertialFactor factor(ImuPreintegration(preintegration_.samples(), {}, kBias),
                              kBodyFromCam);
  Eigen::Matrix<double, 9, 1> residuals;
  ASSERT_TRUE(factor.Evaluate(Blocks().data(), residuals.data(), nullptr));
  EXPECT_TRUE(residuals.allFinite());
}

}  // namespace
}  // namespace airslam
