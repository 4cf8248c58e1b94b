// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/bias_walk_factor.h"

#include <ceres/gradient_checker.h>
#include <gtest/gtest.h>

#include <cmath>

namespace airslam {
namespace {

const ImuNoise kNoise{1e-3, 2e-5, 2e-2, 3e-3, 200};
constexpr double kFirst[] = {0.01, 0.02, 0.03, 0.1, 0.2, 0.3};
constexpr double kSecond[] = {0.0101, 0.02, 0.03, 0.1, 0.2, 0.303};

TEST(BiasWalkFactor, MeasuresTheChangeInSigmas) {
  const BiasWalkFactor factor(kNoise, 0.25);
  const double* blocks[] = {kFirst, kSecond};
  double residuals[6];
  ASSERT_TRUE(factor.Evaluate(blocks, residuals, nullptr));
  EXPECT_NEAR(residuals[0], 1e-4 / (2e-5 * 0.5), 1e-9);
  EXPECT_NEAR(residuals[5], 3e-3 / (3e-3 * 0.5), 1e-9);
  for (int i = 1; i < 5; ++i) EXPECT_EQ(residuals[i], 0);
}

TEST(BiasWalkFactor, Jacobian) {
  const BiasWalkFactor factor(kNoise, 0.25);
  const double* blocks[] = {kFirst, kSecond};
  const std::vector<const ceres::Manifold*> manifolds = {nullptr, nullptr};
  const ceres::GradientChecker checker(&factor, &manifolds, ceres::NumericDiffOptions());
  ceres::GradientChecker::ProbeResults results;
  EXPECT_TRUE(checker.Probe(blocks, 1e-6, &results)) << results.error_log;
}

TEST(BiasWalkFactor, StaysFiniteWithoutWalkOrTime) {
  const double* blocks[] = {kFirst, kSecond};
  double residuals[6];
  ASSERT_TRUE(BiasWalkFactor({}, 0).Evaluate(blocks, residuals, nullptr));
  for (const double residual : residuals) EXPECT_TRUE(std::isfinite(residual));
}

}  // namespace
}  // namespace airslam
