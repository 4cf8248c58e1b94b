// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/inertial_factor.h"

#include <Eigen/Cholesky>

#include "airslam/common/error.h"
#include "airslam/geometry/so3.h"
#include "airslam/geometry/so3_jacobians.h"

namespace airslam {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
template <int kColumns>
using Jacobian = Eigen::Map<Eigen::Matrix<double, 9, kColumns, Eigen::RowMajor>>;

Rigid3 ReadPose(const double* p) {
  return {Eigen::Quaterniond(p[3], p[0], p[1], p[2]), Vector3d(p[4], p[5], p[6])};
}

Matrix9d SquareRootInformation(Matrix9d covariance) {
  const double floors[] = {InertialFactor::kMinSigmaRotation, InertialFactor::kMinSigmaVelocity,
                           InertialFactor::kMinSigmaPosition};
  for (int i = 0; i < 9; ++i) covariance(i, i) += floors[i / 3] * floors[i / 3];
  // covariance = L L', so the whitened residual is L^-1 r.
  const Eigen::LLT<Matrix9d> cholesky(covariance);
  return cholesky.matrixL().solve(Matrix9d::Identity());
}

}  // namespace

// What the residuals and their derivatives share.
struct InertialFactor::Terms {
  Matrix3d r_i, r_j;             // world_from_body
  Vector3d rotation_correction;  // of the preintegration by the bias, radians
  Vector3d rotation_error;       // radians
  Vector3d velocity_change;      // in body i, without gravity
  Vector3d position_change;      // in body i, without gravity and start velocity
  Eigen::Matrix<double, 9, 1> residual;
};

InertialFactor::InertialFactor(const ImuPreintegration& preintegration, const Rigid3& body_from_cam)
    : duration_(preintegration.duration()),
      delta_(preintegration.delta()),
      bias_(preintegration.bias()),
      by_bias_(preintegration.by_bias()),
      weight_(SquareRootInformation(preintegration.covariance())),
      cam_from_body_(body_from_cam.Inverse()) {
  if (!(duration_ > 0)) Fail("an inertial factor needs readings over more than no time");
}

InertialFactor::Terms InertialFactor::ComputeTerms(double const* const* parameters) const {
  const Rigid3 body_i = ReadPose(parameters[0]) * cam_from_body_;
  const Rigid3 body_j = ReadPose(parameters[3]) * cam_from_body_;
  const Eigen::Map<const Vector3d> v_i(parameters[1]), v_j(parameters[4]), gravity(parameters[5]);
  Eigen::Matrix<double, 6, 1> change;
  change << Eigen::Map<const Vector3d>(parameters[2]) - bias_.gyroscope,
      Eigen::Map<const Vector3d>(parameters[2] + 3) - bias_.accelerometer;
  const Eigen::Matrix<double, 9, 1> correction = by_bias_ * change;

  Terms t;
  t.r_i = body_i.rotation.toRotationMatrix();
  t.r_j = body_j.rotation.toRotationMatrix();
  t.rotation_correction = correction.head<3>();
  t.rotation_error = LogSO3((delta_.rotation * ExpSO3(t.rotation_correction)).conjugate() *
                            body_i.rotation.conjugate() * body_j.rotation);
  t.velocity_change = t.r_i.transpose() * (v_j - v_i - duration_ * gravity);
  t.position_change = t.r_i.transpose() * (body_j.translation - body_i.translation -
                                           duration_ * v_i - 0.5 * duration_ * duration_ * gravity);
  t.residual << t.rotation_error, t.velocity_change - delta_.velocity - correction.segment<3>(3),
      t.position_change - delta_.position - correction.tail<3>();
  return t;
}

void InertialFactor::PoseJacobian(const Terms& t, const double* pose, bool second,
                                  double* jacobian) const {
  // By a small turn of the body (right) and a shift of the body in world.
  const Matrix3d log = RightJacobianInverse(t.rotation_error);
  Eigen::Matrix<double, 9, 3> by_turn = Eigen::Matrix<double, 9, 3>::Zero();
  Matrix3d position_by_shift;
  if (second) {
    by_turn.topRows<3>() = log;
    position_by_shift = t.r_i.transpose();
  } else {
    by_turn.topRows<3>() = -log * t.r_j.transpose() * t.r_i;
    by_turn.middleRows<3>(3) = Skew(t.velocity_change);
    by_turn.bottomRows<3>() = Skew(t.position_change);
    position_by_shift = -t.r_i.transpose();
  }
  // By a small turn of the camera: it turns the body with it, and moves the body's origin.
  const Matrix3d body_from_cam = cam_from_body_.rotation.conjugate().toRotationMatrix();
  const Matrix3d& r = second ? t.r_j : t.r_i;
  Eigen::Matrix<double, 9, 3> by_cam_turn = by_turn * body_from_cam;
  by_cam_turn.bottomRows<3>() -=
      position_by_shift * (r * body_from_cam) * Skew(cam_from_body_.translation);
  // The turn by the quaternion (v, w): 2 vec(q^-1 dq).
  const Eigen::Map<const Vector3d> v(pose);
  Eigen::Matrix<double, 3, 4> turn_by_quaternion;
  turn_by_quaternion << 2 * (pose[3] * Matrix3d::Identity() - Skew(v)), -2 * v;
  Jacobian<7> j(jacobian);
  j.leftCols<4>() = weight_ * by_cam_turn * turn_by_quaternion;
  j.rightCols<3>() = weight_.rightCols<3>() * position_by_shift;
}

bool InertialFactor::Evaluate(double const* const* parameters, double* residuals,
                              double** jacobians) const {
  const Terms t = ComputeTerms(parameters);
  Eigen::Map<Eigen::Matrix<double, 9, 1>>{residuals} = weight_ * t.residual;
  if (jacobians == nullptr) return true;
  const Matrix3d back = t.r_i.transpose();
  if (jacobians[0] != nullptr) PoseJacobian(t, parameters[0], false, jacobians[0]);
  if (jacobians[1] != nullptr) {
    Eigen::Matrix<double, 9, 3> j;
    j << Matrix3d::Zero(), -back, -duration_ * back;
    Jacobian<3>{jacobians[1]} = weight_ * j;
  }
  if (jacobians[2] != nullptr) {
    Matrix96d j = -by_bias_;
    j.topLeftCorner<3, 3>() = -RightJacobianInverse(t.rotation_error) *
                              ExpSO3(-t.rotation_error).toRotationMatrix() *
                              RightJacobian(t.rotation_correction) * by_bias_.topLeftCorner<3, 3>();
    Jacobian<6>{jacobians[2]} = weight_ * j;
  }
  if (jacobians[3] != nullptr) PoseJacobian(t, parameters[3], true, jacobians[3]);
  if (jacobians[4] != nullptr) {
    Jacobian<3>{jacobians[4]} = weight_.middleCols<3>(3) * back;
  }
  if (jacobians[5] != nullptr) {
    Eigen::Matrix<double, 9, 3> j;
    j << Matrix3d::Zero(), -duration_ * back, -0.5 * duration_ * duration_ * back;
    Jacobian<3>{jacobians[5]} = weight_ * j;
  }
  return true;
}

}  // namespace airslam
