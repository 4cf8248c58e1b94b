// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/geometry/so3_jacobians.h"

#include <cmath>

#include "airslam/geometry/so3.h"

namespace airslam {
namespace {

// Below it the quotients lose their digits and the Taylor series have all of them.
constexpr double kSmallAngle = 1e-3;

}  // namespace

Eigen::Matrix3d RightJacobian(const Eigen::Vector3d& rotation_vector) {
  const double angle = rotation_vector.norm(), square = angle * angle;
  const bool small = angle < kSmallAngle;
  const double a = small ? 0.5 - square / 24 : (1 - std::cos(angle)) / square;
  const double b = small ? 1.0 / 6 - square / 120 : (angle - std::sin(angle)) / (square * angle);
  const Eigen::Matrix3d skew = Skew(rotation_vector);
  return Eigen::Matrix3d::Identity() - a * skew + b * skew * skew;
}

Eigen::Matrix3d RightJacobianInverse(const Eigen::Vector3d& rotation_vector) {
  const double angle = rotation_vector.norm(), square = angle * angle;
  const double c = angle < kSmallAngle ? 1.0 / 12 + square / 720
                                       : 1 / square - 0.5 / (angle * std::tan(0.5 * angle));
  const Eigen::Matrix3d skew = Skew(rotation_vector);
  return Eigen::Matrix3d::Identity() + 0.5 * skew + c * skew * skew;
}

}  // namespace airslam
