// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/geometry/so3.h"

#include <cmath>

namespace airslam {

Eigen::Matrix3d Skew(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

Eigen::Quaterniond ExpSO3(const Eigen::Vector3d& rotation_vector) {
  const double angle = rotation_vector.norm();
  const double half = 0.5 * angle;
  // sin(half) / angle by its Taylor series near zero, where the quotient loses its digits.
  const double scale = angle < 1e-6 ? 0.5 - angle * angle / 48.0 : std::sin(half) / angle;
  const Eigen::Vector3d xyz = scale * rotation_vector;
  return Eigen::Quaterniond(std::cos(half), xyz.x(), xyz.y(), xyz.z());
}

Eigen::Vector3d LogSO3(const Eigen::Quaterniond& rotation) {
  const double sign = rotation.w() < 0 ? -1.0 : 1.0;  // q and -q are the same rotation
  const Eigen::Vector3d xyz = sign * rotation.vec();
  const double w = sign * rotation.w();
  const double sine = xyz.norm();
  if (sine < 1e-9) return 2.0 / w * xyz;
  return 2.0 * std::atan2(sine, w) / sine * xyz;
}

}  // namespace airslam
