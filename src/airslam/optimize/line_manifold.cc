// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/line_manifold.h"

#include <cmath>

#include "airslam/geometry/so3.h"

namespace airslam {
namespace {

using RowMajor64 = Eigen::Matrix<double, 6, 4, Eigen::RowMajor>;
using RowMajor46 = Eigen::Matrix<double, 4, 6, Eigen::RowMajor>;
using RowMajor43 = Eigen::Matrix<double, 4, 3, Eigen::RowMajor>;
using ConstQuaternion = Eigen::Map<const Eigen::Quaterniond>;

// Derivative of q (1, theta / 2) by theta; four times its transpose is its left inverse.
RowMajor43 ByTurn(const ConstQuaternion& q) {
  RowMajor43 jacobian;
  jacobian.topRows<3>() = 0.5 * (q.w() * Eigen::Matrix3d::Identity() + Skew(q.vec()));
  jacobian.row(3) = -0.5 * q.vec().transpose();
  return jacobian;
}

}  // namespace

LineParameter ToParameter(const PluckerLine& line) {
  const OrthonormalLine o = ToOrthonormal(line);
  return {o.u.x(), o.u.y(), o.u.z(), o.u.w(), o.w.x(), o.w.y()};
}

PluckerLine LineFromParameter(const LineParameter& p) {
  OrthonormalLine line{Eigen::Quaterniond(p[3], p[0], p[1], p[2]), {p[4], p[5]}};
  constexpr double kMinInfinity = 1e-9;
  if (std::abs(line.w.y()) < kMinInfinity) line.w.y() = std::copysign(kMinInfinity, line.w.y());
  return FromOrthonormal(line).value();
}

bool LineManifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  const Eigen::Quaterniond turned =
      ConstQuaternion(x) * ExpSO3(Eigen::Map<const Eigen::Vector3d>(delta));
  const double cosine = std::cos(delta[3]), sine = std::sin(delta[3]);
  const double w1 = x[4] * cosine - x[5] * sine, w2 = x[5] * cosine + x[4] * sine;
  Eigen::Map<Eigen::Matrix<double, 6, 1>> target(x_plus_delta);
  target << turned.normalized().coeffs(), Eigen::Vector2d(w1, w2).normalized();
  return true;
}

bool LineManifold::PlusJacobian(const double* x, double* jacobian) const {
  Eigen::Map<RowMajor64> j(jacobian);
  j.setZero();
  j.topLeftCorner<4, 3>() = ByTurn(ConstQuaternion(x));
  j.bottomRightCorner<2, 1>() << -x[5], x[4];
  return true;
}

bool LineManifold::Minus(const double* y, const double* x, double* y_minus_x) const {
  Eigen::Map<Eigen::Vector3d> turn(y_minus_x);
  turn = LogSO3(ConstQuaternion(x).conjugate() * ConstQuaternion(y));
  y_minus_x[3] = std::atan2(x[4] * y[5] - x[5] * y[4], x[4] * y[4] + x[5] * y[5]);
  return true;
}

bool LineManifold::MinusJacobian(const double* x, double* jacobian) const {
  Eigen::Map<RowMajor46> j(jacobian);
  j.setZero();
  j.topLeftCorner<3, 4>() = 4 * ByTurn(ConstQuaternion(x)).transpose();
  j.bottomRightCorner<1, 2>() << -x[5], x[4];
  return true;
}

}  // namespace airslam
