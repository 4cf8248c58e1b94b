// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/geometry/so3.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace airslam {
namespace {

constexpr double kPi = 3.14159265358979323846;

// exp([v]x) by its power series, an independent way to the same matrix.
Eigen::Matrix3d SeriesExp(const Eigen::Vector3d& v) {
  Eigen::Matrix3d term = Eigen::Matrix3d::Identity();
  Eigen::Matrix3d sum = term;
  for (int n = 1; n < 40; ++n) {
    term = term * Skew(v) / n;
    sum += term;
  }
  return sum;
}

TEST(Skew, IsTheCrossProduct) {
  const Eigen::Vector3d v(1, -2, 3), w(0.5, 4, -1);
  EXPECT_LT((Skew(v) * w - v.cross(w)).norm(), 1e-15);
}

TEST(ExpSO3, EqualsThePowerSeries) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (const double angle : {0.0, 1e-12, 1e-7, 1e-6, 1.1e-6, 1e-3, 0.5, 2.0, kPi}) {
    Eigen::Vector3d axis(uniform(random), uniform(random), uniform(random));
    axis.normalize();
    const Eigen::Quaterniond q = ExpSO3(angle * axis);
    EXPECT_NEAR(q.norm(), 1.0, 1e-14) << angle;
    EXPECT_LT((q.toRotationMatrix() - SeriesExp(angle * axis)).norm(), 1e-13) << angle;
  }
}

TEST(ExpSO3, TurnsCounterClockwise) {
  const Eigen::Vector3d turned = ExpSO3({0, 0, kPi / 2}) * Eigen::Vector3d::UnitX();
  EXPECT_LT((turned - Eigen::Vector3d::UnitY()).norm(), 1e-15);
}

TEST(LogSO3, InvertsExpFromZeroToPi) {
  std::mt19937 random(2);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (const double angle : {0.0, 1e-15, 1e-10, 1e-9, 1e-8, 1e-4, 1.0, 3.0, kPi - 1e-6}) {
    Eigen::Vector3d axis(uniform(random), uniform(random), uniform(random));
    axis.normalize();
    const Eigen::Vector3d v = angle * axis;
    EXPECT_LT((LogSO3(ExpSO3(v)) - v).norm(), 1e-14 + 1e-9 * angle) << angle;
  }
}

TEST(LogSO3, TakesTheShortWayAround) {
  const Eigen::Vector3d v = LogSO3(ExpSO3({0, 0, 1.5 * kPi}));
  EXPECT_LT((v - Eigen::Vector3d(0, 0, -0.5 * kPi)).norm(), 1e-12);
}

TEST(LogSO3, IsTheSameForQAndMinusQ) {
  const Eigen::Quaterniond q = ExpSO3({0.3, -0.2, 0.1});
  const Eigen::Quaterniond minus(-q.w(), -q.x(), -q.y(), -q.z());
  EXPECT_LT((LogSO3(q) - LogSO3(minus)).norm(), 1e-15);
}

}  // namespace
}  // namespace airslam
