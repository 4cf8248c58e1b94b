// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/relative_pose_factor.h"

#include <ceres/gradient_checker.h>
#include <gtest/gtest.h>

#include "airslam/common/error.h"
#include "airslam/geometry/se3.h"
#include "airslam/geometry/so3.h"
#include "airslam/optimize/pose_parameter.h"

namespace airslam {
namespace {

const Rigid3 kFrom(ExpSO3({0.3, -0.5, 1.1}), {1, 2, -3});
const Rigid3 kTo(ExpSO3({-0.4, 0.2, 0.7}), {2, 1.5, -1});

Matrix6d SomeCovariance() {
  Matrix6d a;
  for (int i = 0; i < 36; ++i) a(i / 6, i % 6) = 0.1 * ((7 * i) % 11) - 0.4;
  return 0.01 * (a * a.transpose() + Matrix6d::Identity());
}

Vector6d Residual(const RelativePose& measured, const Rigid3& from, const Rigid3& to) {
  const PoseParameter a = ToParameter(from), b = ToParameter(to);
  const double* blocks[] = {a.data(), b.data()};
  Vector6d residual;
  EXPECT_TRUE(RelativePoseFactor(measured).Evaluate(blocks, residual.data(), nullptr));
  return residual;
}

TEST(RelativePoseFactor, VanishesWhereItWasMeasuredWhateverTheWorld) {
  const RelativePose measured{0, 1, kFrom.Inverse() * kTo, SomeCovariance()};
  EXPECT_LT(Residual(measured, kFrom, kTo).norm(), 1e-12);
  const Rigid3 moved(ExpSO3({1, 0.2, -0.3}), {5, -6, 7});
  EXPECT_LT(Residual(measured, moved * kFrom, moved * kTo).norm(), 1e-12);
}

TEST(RelativePoseFactor, IsTheLogarithmInSigmas) {
  const Rigid3 error(ExpSO3({0.1, 0.2, -0.1}), {0.3, -0.2, 0.4});
  const RelativePose measured{0, 1, kFrom.Inverse() * kTo, SomeCovariance()};
  const Vector6d log = LogSE3(error);
  const double expected = log.dot(SomeCovariance().ldlt().solve(log));
  EXPECT_NEAR(Residual(measured, kFrom, kTo * error).squaredNorm() / expected, 1, 1e-9);
}

TEST(RelativePoseFactor, Jacobians) {
  const PoseManifold manifold;
  const std::vector<const ceres::Manifold*> manifolds = {&manifold, &manifold};
  const Rigid3 errors[] = {
      {}, {ExpSO3({0.6, -0.3, 0.5}), {0.5, 1, -2}}, {ExpSO3({1e-4, 0, 1e-4}), {0.5, 1, -2}}};
  for (const Rigid3& error : errors) {
    const RelativePoseFactor factor({0, 1, kFrom.Inverse() * kTo * error, SomeCovariance()});
    const ceres::GradientChecker checker(&factor, &manifolds, ceres::NumericDiffOptions());
    ceres::GradientChecker::ProbeResults results;
    PoseParameter from = ToParameter(kFrom), to = ToParameter(kTo);
    const double* blocks[] = {from.data(), to.data()};
    EXPECT_TRUE(checker.Probe(blocks, 1e-6, &results)) << results.error_log;
  }
}

TEST(RelativePoseFactor, NeedsACovariance) {
  EXPECT_THROW(RelativePoseFactor({0, 1, Rigid3(), Matrix6d::Zero()}), Error);
}

}  // namespace
}  // namespace airslam
