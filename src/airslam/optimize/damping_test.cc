// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/damping.h"

#include <gtest/gtest.h>

#include <Eigen/LU>

#include <limits>

namespace airslam {
namespace {

TEST(Damping, IsAShareOfTheDiagonalButNeverNothing) {
  const Eigen::Vector3d damping = Damping().Of(Eigen::Vector3d(50, 0, 2e6));
  EXPECT_DOUBLE_EQ(damping.x(), 50e-4);
  EXPECT_DOUBLE_EQ(damping.y(), 1e-10);
  EXPECT_DOUBLE_EQ(damping.z(), 2e2);
}

TEST(Damping, GrowsAfterFailuresAndShrinksAfterSuccess) {
  const Eigen::Vector2d one(1, 1);
  Damping damping;
  EXPECT_FALSE(damping.Judge(0.0005));  // hardly better
  EXPECT_DOUBLE_EQ(damping.Of(one).eval().x(), 2e-4);
  EXPECT_FALSE(damping.Judge(-3));
  EXPECT_DOUBLE_EQ(damping.Of(one).eval().x(), 8e-4) << "twice as fast the second time";
  EXPECT_FALSE(damping.Judge(std::numeric_limits<double>::quiet_NaN()));
  EXPECT_DOUBLE_EQ(damping.Of(one).eval().x(), 64e-4);
  EXPECT_TRUE(damping.Judge(1));  // as foreseen
  EXPECT_DOUBLE_EQ(damping.Of(one).eval().x(), 64e-4 / 3);
  EXPECT_TRUE(damping.Judge(0.5));
  EXPECT_DOUBLE_EQ(damping.Of(one).eval().x(), 64e-4 / 3) << "so so: it stays";
  EXPECT_FALSE(damping.Judge(-1));
  EXPECT_DOUBLE_EQ(damping.Of(one).eval().x(), 128e-4 / 3);
}

// Of a quadratic, the decrease along the damped step is what the function says.
TEST(Damping, DecreaseOfTheModel) {
  Eigen::Matrix2d h;
  h << 4, 1, 1, 3;
  const Eigen::Vector2d gradient(1, -2), damping(0.4, 0.3);
  const Eigen::Matrix2d damped = h + Eigen::Matrix2d(damping.asDiagonal());
  const Eigen::Vector2d x = damped.inverse() * gradient;
  EXPECT_NEAR(Damping::Decrease(x, gradient, damping), gradient.dot(x) - 0.5 * x.dot(h * x), 1e-15);
}

}  // namespace
}  // namespace airslam
