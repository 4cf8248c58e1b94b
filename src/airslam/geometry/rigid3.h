// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace airslam {

// A rigid transform named b_from_a: point_in_b = b_from_a * point_in_a = rotation * point_in_a +
// translation. Lengths are metres. The rotation is a unit quaternion.
struct Rigid3 {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  Rigid3() = default;
  Rigid3(const Eigen::Quaterniond& r, const Eigen::Vector3d& t)
      : rotation(r.normalized()), translation(t) {}

  // From a 4x4 (or 3x4) matrix [R t]; R is projected to the nearest unit quaternion.
  static Rigid3 FromMatrix(const Eigen::Matrix4d& matrix) {
    return {Eigen::Quaterniond(Eigen::Matrix3d(matrix.topLeftCorner<3, 3>())),
            matrix.topRightCorner<3, 1>()};
  }

  Eigen::Matrix4d ToMatrix() const {
    Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
    matrix.topLeftCorner<3, 3>() = rotation.toRotationMatrix();
    matrix.topRightCorner<3, 1>() = translation;
    return matrix;
  }

  Rigid3 Inverse() const {
    const Eigen::Quaterniond inverse = rotation.conjugate();
    return {inverse, -(inverse * translation)};
  }

  // c_from_a = c_from_b * b_from_a.
  Rigid3 operator*(const Rigid3& b_from_a) const {
    return {rotation * b_from_a.rotation, rotation * b_from_a.translation + translation};
  }

  Eigen::Vector3d operator*(const Eigen::Vector3d& point_in_a) const {
    return rotation * point_in_a + translation;
  }

  // Angle of the rotation in radians, in [0, pi].
  double Angle() const { return Eigen::AngleAxisd(rotation).angle(); }
};

}  // namespace airslam
