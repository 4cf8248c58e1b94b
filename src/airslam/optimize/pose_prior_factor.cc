// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/pose_prior_factor.h"

#include "airslam/geometry/so3.h"

namespace airslam {

bool PosePriorFactor::Evaluate(double const* const* parameters, double* residuals,
                               double** jacobians) const {
  const Eigen::Map<const Eigen::Vector3d> v(parameters[0]);
  const double w = parameters[0][3];
  const Eigen::Map<const Eigen::Vector3d> t(parameters[0] + 4);
  const Eigen::Vector3d& a = prior_.world_from_cam.rotation.vec();
  const double b = prior_.world_from_cam.rotation.w();
  // prior^-1 * q has the scalar part a.v + b w; q and -q are one rotation, so its sign is free.
  const double sign = a.dot(v) + b * w < 0 ? -1.0 : 1.0;
  const double rotation_weight = 2 * sign / prior_.sigma_rotation;
  const double position_weight = 1 / prior_.sigma_position;

  Eigen::Map<Eigen::Matrix<double, 6, 1>> r(residuals);
  r.head<3>() = rotation_weight * (b * v - w * a - a.cross(v));
  r.tail<3>() = position_weight * (t - prior_.world_from_cam.translation);
  if (jacobians != nullptr && jacobians[0] != nullptr) {
    Eigen::Map<Eigen::Matrix<double, 6, 7, Eigen::RowMajor>> j(jacobians[0]);
    j.setZero();
    j.topLeftCorner<3, 3>() = rotation_weight * (b * Eigen::Matrix3d::Identity() - Skew(a));
    j.block<3, 1>(0, 3) = -rotation_weight * a;
    j.bottomRightCorner<3, 3>() = position_weight * Eigen::Matrix3d::Identity();
  }
  return true;
}

}  // namespace airslam
