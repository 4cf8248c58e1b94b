// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/geometry/se3.h"

#include <gtest/gtest.h>

#include <unsupported/Eigen/MatrixFunctions>
#include <vector>

#include "airslam/geometry/so3.h"

namespace airslam {
namespace {

const std::vector<Eigen::Vector3d> kRotations = {
    {0, 0, 0},        {1e-6, 2e-6, -1e-6}, {0.01, -0.005, 0.012}, {0.012, -0.01, 0.014},
    {0.3, -0.2, 0.5}, {1.5, 1.2, -2.0}};
const Eigen::Vector3d kTranslation(0.7, -1.2, 2.5);

TEST(LogSE3, IsTheMatrixLogarithm) {
  for (const Eigen::Vector3d& rotation : kRotations) {
    const Rigid3 transform(ExpSO3(rotation), kTranslation);
    const Vector6d log = LogSE3(transform);
    Eigen::Matrix4d twist = Eigen::Matrix4d::Zero();
    twist.topLeftCorner<3, 3>() = Skew(log.head<3>());
    twist.topRightCorner<3, 1>() = log.tail<3>();
    EXPECT_LT((twist.exp() - transform.ToMatrix()).norm(), 1e-9) << rotation.transpose();
  }
}

TEST(LogSE3, DerivativeMatchesDifferences) {
  constexpr double kStep = 1e-6;
  for (const Eigen::Vector3d& rotation : kRotations) {
    const Rigid3 transform(ExpSO3(rotation), kTranslation);
    Eigen::Matrix<double, 6, 6> analytic, numeric;
    LogSE3(transform, &analytic);
    for (int i = 0; i < 6; ++i) {
      const auto moved = [&](double step) {
        Vector6d delta = Vector6d::Zero();
        delta[i] = step;
        return LogSE3({transform.rotation * ExpSO3(delta.head<3>()),
                       transform.translation + delta.tail<3>()});
      };
      numeric.col(i) = (moved(kStep) - moved(-kStep)) / (2 * kStep);
    }
    EXPECT_LT((analytic - numeric).norm(), 1e-7) << rotation.transpose() << "\n"
                                                 << analytic << "\n\n"
                                                 << numeric;
  }
}

}  // namespace
}  // namespace airslam
