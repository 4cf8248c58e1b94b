// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/geometry/se3.h"

#include <cmath>

#include "airslam/geometry/so3.h"
#include "airslam/geometry/so3_jacobians.h"

namespace airslam {
namespace {

// J_l^-1 = I - [phi]x / 2 + c [phi]x^2 with c(theta) = 1/theta^2 - cot(theta/2) / (2 theta), and
// c'(theta) / theta.
struct Coefficients {
  double c, slope;
};

Coefficients At(double theta) {
  // Below, the closed forms cancel; the next terms of the series are theta^4 / 30240 and
  // theta^2 / 7560.
  if (theta < 0.02) return {1.0 / 12 + theta * theta / 720, 1.0 / 360};
  const double cotangent = 1 / std::tan(theta / 2), sine = std::sin(theta / 2);
  const double square = theta * theta;
  const double derivative =
      -2 / (square * theta) + cotangent / (2 * square) + 1 / (4 * theta * sine * sine);
  return {1 / square - cotangent / (2 * theta), derivative / theta};
}

}  // namespace

Vector6d LogSE3(const Rigid3& transform, Eigen::Matrix<double, 6, 6>* by_error) {
  const Eigen::Vector3d phi = LogSO3(transform.rotation);
  const Eigen::Vector3d& t = transform.translation;
  const Coefficients k = At(phi.norm());
  const Eigen::Vector3d twice = phi * phi.dot(t) - phi.squaredNorm() * t;  // [phi]x^2 t
  Vector6d log;
  log << phi, t - 0.5 * phi.cross(t) + k.c * twice;
  if (by_error == nullptr) return log;
  const Eigen::Matrix3d by_turn = RightJacobianInverse(phi);
  const Eigen::Matrix3d by_phi = 0.5 * Skew(t) + k.slope * twice * phi.transpose() +
                                 k.c * (phi.dot(t) * Eigen::Matrix3d::Identity() +
                                        phi * t.transpose() - 2 * t * phi.transpose());
  by_error->topLeftCorner<3, 3>() = by_turn;
  by_error->topRightCorner<3, 3>().setZero();
  by_error->bottomLeftCorner<3, 3>() = by_phi * by_turn;
  by_error->bottomRightCorner<3, 3>() = RightJacobianInverse(-phi);
  return log;
}

}  // namespace airslam
