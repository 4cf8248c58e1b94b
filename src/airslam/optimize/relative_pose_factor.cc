// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/relative_pose_factor.h"

#include <Eigen/Cholesky>

#include "airslam/common/error.h"
#include "airslam/geometry/se3.h"
#include "airslam/geometry/so3.h"
#include "airslam/optimize/pose_parameter.h"

namespace airslam {
namespace {

using RowMajor67 = Eigen::Matrix<double, 6, 7, Eigen::RowMajor>;
using Matrix34 = Eigen::Matrix<double, 3, 4>;

Rigid3 PoseOf(const double* p) {
  Rigid3 pose;  // not normalised: Ceres keeps it so, and numeric differences need every bit
  pose.rotation = Eigen::Quaterniond(p[3], p[0], p[1], p[2]);
  pose.translation = Eigen::Vector3d(p[4], p[5], p[6]);
  return pose;
}

// The right turn that a change of the coefficients (x, y, z, w) makes: 2 vec(q^-1 dq).
Matrix34 TurnByQuaternion(const Eigen::Quaterniond& q) {
  Matrix34 turn;
  turn.leftCols<3>() = 2 * (q.w() * Eigen::Matrix3d::Identity() - Skew(q.vec()));
  turn.col(3) = -2 * q.vec();
  return turn;
}

}  // namespace

RelativePoseFactor::RelativePoseFactor(const RelativePose& measured)
    : to_from_from_(measured.from_from_to.Inverse()) {
  const Eigen::LLT<Matrix6d> cholesky(measured.covariance);  // covariance = L L'
  if (cholesky.info() != Eigen::Success) {
    Fail("the covariance of a relative pose is not positive definite");
  }
  weight_ = cholesky.matrixL().solve(Matrix6d::Identity());
}

bool RelativePoseFactor::Evaluate(double const* const* parameters, double* residuals,
                                  double** jacobians) const {
  const Rigid3 from = PoseOf(parameters[0]), to = PoseOf(parameters[1]);
  const Rigid3 relative = from.Inverse() * to;
  Matrix6d by_error;
  Eigen::Map<Eigen::Matrix<double, 6, 1>> residual(residuals);
  residual = weight_ * LogSE3(to_from_from_ * relative, &by_error);
  if (jacobians == nullptr) return true;

  // Of the error's turn and translation by the turns and positions of both poses.
  const Matrix6d weighted = weight_ * by_error;
  const Eigen::Matrix3d measured = to_from_from_.rotation.toRotationMatrix();
  const Eigen::Matrix3d by_position = measured * from.rotation.conjugate().toRotationMatrix();
  if (jacobians[0] != nullptr) {
    Matrix6d by_from = Matrix6d::Zero();
    by_from.topLeftCorner<3, 3>() = -relative.rotation.conjugate().toRotationMatrix();
    by_from.bottomLeftCorner<3, 3>() = measured * Skew(relative.translation);
    by_from.bottomRightCorner<3, 3>() = -by_position;
    Eigen::Map<RowMajor67> jacobian(jacobians[0]);
    jacobian.leftCols<4>() = weighted * by_from.leftCols<3>() * TurnByQuaternion(from.rotation);
    jacobian.rightCols<3>() = weighted * by_from.rightCols<3>();
  }
  if (jacobians[1] != nullptr) {
    Eigen::Map<RowMajor67> jacobian(jacobians[1]);
    jacobian.leftCols<4>() = weighted.leftCols<3>() * TurnByQuaternion(to.rotation);
    jacobian.rightCols<3>() = weighted.rightCols<3>() * by_position;
  }
  return true;
}

}  // namespace airslam
