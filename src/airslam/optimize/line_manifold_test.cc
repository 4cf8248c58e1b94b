// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/line_manifold.h"

#include <ceres/manifold_test_utils.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "airslam/geometry/so3.h"

namespace airslam {
namespace {

// What EXPECT_THAT_MANIFOLD_INVARIANTS_HOLD names without its namespace.
using ceres::HasCorrectMinusJacobianAt;
using ceres::HasCorrectPlusJacobianAt;
using ceres::HasCorrectRightMultiplyByPlusJacobianAt;
using ceres::MinusPlusIsIdentityAt;
using ceres::MinusPlusJacobianIsIdentityAt;
using ceres::PlusMinusIsIdentityAt;
using ceres::Vector;
using ceres::XMinusXIsZeroAt;
using ceres::XPlusZeroIsXAt;

LineParameter RandomLine(std::mt19937& random) {
  std::normal_distribution<double> normal(0, 3);
  return ToParameter(PluckerLine::FromPoints({normal(random), normal(random), normal(random)},
                                             {normal(random), normal(random), normal(random)})
                         .value());
}

TEST(LineManifold, KeepsTheInvariantsOfAManifold) {
  const LineManifold manifold;
  std::mt19937 random(4);
  std::uniform_real_distribution<double> turn(-1, 1);
  for (int i = 0; i < 50; ++i) {
    const LineParameter x = RandomLine(random), y = RandomLine(random);
    const Vector x_vector = Eigen::Map<const Eigen::VectorXd>(x.data(), 6);
    Vector y_vector = Eigen::Map<const Eigen::VectorXd>(y.data(), 6);
    // The matcher compares the six numbers, so of q and -q take the one that lies nearer.
    if (y_vector.head<4>().dot(x_vector.head<4>()) < 0) y_vector.head<4>() *= -1;
    Vector delta(4);
    delta << turn(random), turn(random), turn(random), turn(random);
    EXPECT_THAT_MANIFOLD_INVARIANTS_HOLD(manifold, x_vector, delta, y_vector, 1e-8);
  }
}

TEST(LineManifold, PlusStaysALine) {
  const LineManifold manifold;
  std::mt19937 random(5);
  std::uniform_real_distribution<double> turn(-3, 3);
  LineParameter x = RandomLine(random);
  for (int i = 0; i < 1000; ++i) {
    const double delta[] = {turn(random), turn(random), turn(random), turn(random)};
    ASSERT_TRUE(manifold.Plus(x.data(), delta, x.data()));  // in place
  }
  EXPECT_NEAR(Eigen::Map<Eigen::Vector4d>(x.data()).norm(), 1, 1e-12);
  EXPECT_NEAR(Eigen::Map<Eigen::Vector2d>(x.data() + 4).norm(), 1, 1e-12);
  const PluckerLine line = LineFromParameter(x);
  EXPECT_NEAR(line.v.norm(), 1, 1e-12);
  EXPECT_NEAR(line.v.dot(line.n.normalized()), 0, 1e-12);
}

TEST(LineManifold, TheStepsMoveTheLineAsTheHeaderSays) {
  const LineManifold manifold;
  const PluckerLine line{{0, 0, -2}, {1, 0, 0}};  // y = 2, z = 0: n along -z, v along x
  const LineParameter x = ToParameter(line);
  const Eigen::Vector3d axes[] = {line.n.normalized(), line.v, line.n.cross(line.v).normalized()};
  for (int k = 0; k < 3; ++k) {
    double delta[4] = {0, 0, 0, 0};
    delta[k] = 0.3;
    LineParameter moved;
    ASSERT_TRUE(manifold.Plus(x.data(), delta, moved.data()));
    const PluckerLine expected = Rigid3(ExpSO3(0.3 * axes[k]), Eigen::Vector3d::Zero()) * line;
    EXPECT_LT((LineFromParameter(moved).n - expected.n).norm(), 1e-12) << k;
    EXPECT_LT((LineFromParameter(moved).v - expected.v).norm(), 1e-12) << k;
  }
  // (w1, w2) = (2, 1) / sqrt(5) turned by the angle between (2, 1) and (1, 1): distance 1.
  const double delta[] = {0, 0, 0, std::atan2(1, 1) - std::atan2(1, 2)};
  LineParameter moved;
  ASSERT_TRUE(manifold.Plus(x.data(), delta, moved.data()));
  EXPECT_LT((LineFromParameter(moved).n - 0.5 * line.n).norm(), 1e-12);
  EXPECT_LT((LineFromParameter(moved).v - line.v).norm(), 1e-12);
}

TEST(LineManifold, ParametersAndBack) {
  const PluckerLine line = PluckerLine::FromPoints({1, 2, 3}, {-2, 0.5, 7}).value();
  const PluckerLine again = LineFromParameter(ToParameter(line));
  EXPECT_LT((again.n - line.n).norm(), 1e-12);
  EXPECT_LT((again.v - line.v).norm(), 1e-12);
  const PluckerLine far = LineFromParameter({0, 0, 0, 1, 1, 0});  // at infinity
  EXPECT_TRUE(far.n.allFinite());
  EXPECT_GT(far.n.norm(), 1e8);
}

}  // namespace
}  // namespace airslam
