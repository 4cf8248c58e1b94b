// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/pose_prior_factor.h"

#include <Eigen/Cholesky>
#include <cmath>

#include "airslam/common/error.h"
#include "airslam/geometry/so3.h"
#include "airslam/optimize/worst_sigma.h"

namespace airslam {

PosePrior::PosePrior(const Rigid3& pose, double sigma_rotation, double sigma_position)
    : world_from_cam(pose) {
  weight.diagonal().head<3>().setConstant(1 / sigma_rotation);
  weight.diagonal().tail<3>().setConstant(1 / sigma_position);
}

PosePrior PosePrior::FromCovariance(const Rigid3& pose, const Matrix6d& covariance) {
  const Eigen::LLT<Matrix6d> cholesky(covariance);  // covariance = L L'
  if (cholesky.info() != Eigen::Success) Fail("the covariance of a pose is not positive definite");
  PosePrior prior;
  prior.world_from_cam = pose;
  prior.weight = cholesky.matrixL().solve(Matrix6d::Identity());
  return prior;
}

double PosePrior::SigmaRotation() const {
  const Matrix6d covariance = (weight.transpose() * weight).inverse();
  return WorstSigma<3>(covariance.topLeftCorner<3, 3>());
}

double PosePrior::SigmaPosition() const {
  const Matrix6d covariance = (weight.transpose() * weight).inverse();
  return WorstSigma<3>(covariance.bottomRightCorner<3, 3>());
}

bool PosePriorFactor::Evaluate(double const* const* parameters, double* residuals,
                               double** jacobians) const {
  const Eigen::Map<const Eigen::Vector3d> v(parameters[0]);
  const double w = parameters[0][3];
  const Eigen::Map<const Eigen::Vector3d> t(parameters[0] + 4);
  const Eigen::Vector3d& a = prior_.world_from_cam.rotation.vec();
  const double b = prior_.world_from_cam.rotation.w();
  // prior^-1 * q has the scalar part a.v + b w; q and -q are one rotation, so its sign is free.
  const double sign = a.dot(v) + b * w < 0 ? -1.0 : 1.0;

  Eigen::Matrix<double, 6, 1> error;
  error << 2 * sign * (b * v - w * a - a.cross(v)), t - prior_.world_from_cam.translation;
  Eigen::Map<Eigen::Matrix<double, 6, 1>>{residuals} = prior_.weight * error;
  if (jacobians != nullptr && jacobians[0] != nullptr) {
    Eigen::Matrix<double, 6, 7> by_pose = Eigen::Matrix<double, 6, 7>::Zero();
    by_pose.topLeftCorner<3, 3>() = 2 * sign * (b * Eigen::Matrix3d::Identity() - Skew(a));
    by_pose.block<3, 1>(0, 3) = -2 * sign * a;
    by_pose.bottomRightCorner<3, 3>().setIdentity();
    Eigen::Map<Eigen::Matrix<double, 6, 7, Eigen::RowMajor>>{jacobians[0]} =
        prior_.weight * by_pose;
  }
  return true;
}

}  // namespace airslam
