// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/geometry/so3_jacobians.h"

#include <gtest/gtest.h>

#include "airslam/geometry/so3.h"

namespace airslam {
namespace {

const Eigen::Vector3d kVectors[] = {{0, 0, 0},      {1e-9, 2e-9, -1e-9}, {9e-4, -3e-4, 0},
                                    {1.1e-3, 0, 0}, {0.3, -0.8, 0.5},    {2, 1, -2}};

TEST(So3Jacobians, MatchNumericDifferences) {
  constexpr double kStep = 1e-6;
  for (const Eigen::Vector3d& v : kVectors) {
    Eigen::Matrix3d right, inverse;
    for (int i = 0; i < 3; ++i) {
      const Eigen::Vector3d d = kStep * Eigen::Vector3d::Unit(i);
      right.col(i) = (LogSO3(ExpSO3(v).conjugate() * ExpSO3(v + d)) -
                      LogSO3(ExpSO3(v).conjugate() * ExpSO3(v - d))) /
                     (2 * kStep);
      inverse.col(i) =
          (LogSO3(ExpSO3(v) * ExpSO3(d)) - LogSO3(ExpSO3(v) * ExpSO3(-d))) / (2 * kStep);
    }
    EXPECT_LT((RightJacobian(v) - right).norm(), 1e-8) << v.transpose();
    EXPECT_LT((RightJacobianInverse(v) - inverse).norm(), 1e-8) << v.transpose();
  }
}

TEST(So3Jacobians, AreInverseToEachOther) {
  for (const Eigen::Vector3d& v : kVectors) {
    const Eigen::Matrix3d product = RightJacobian(v) * RightJacobianInverse(v);
    EXPECT_LT((product - Eigen::Matrix3d::Identity()).norm(), 1e-9) << v.transpose();
  }
}

}  // namespace
}  // namespace airslam
