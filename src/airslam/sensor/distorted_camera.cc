// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/sensor/distorted_camera.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

namespace airslam {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
// The plane z = 1 ends at 90 degrees; an equidistant lens is used up to here.
constexpr double kMaxTheta = 89.0 * 3.14159265358979323846 / 180.0;
constexpr int kMaxIterations = 50;
constexpr double kTolerance = 1e-12;

// g(r) = r * (1 + c1 r^2 + c2 r^4 + c3 r^6 + c4 r^8), the radial part of both models: of the radius
// on the plane z = 1 (radial-tangential) or of the angle from the optical axis (equidistant).
struct RadialPolynomial {
  std::array<double, 4> c = {0, 0, 0, 0};

  double Value(double r) const {
    const double s = r * r;
    return r * (1 + s * (c[0] + s * (c[1] + s * (c[2] + s * c[3]))));
  }
  double Derivative(double r) const {
    const double s = r * r;
    return 1 + s * (3 * c[0] + s * (5 * c[1] + s * (7 * c[2] + s * 9 * c[3])));
  }

  // The first r in (0, end] at which g stops growing, else `end`.
  double GrowsUpTo(double end) const {
    constexpr int kSteps = 400;
    double low = 0;
    for (int i = 1; i <= kSteps; ++i) {
      double high = end * i / kSteps;
      if (Derivative(high) > 0) {
        low = high;
        continue;
      }
      for (int k = 0; k < 60; ++k) {
        const double middle = 0.5 * (low + high);
        (Derivative(middle) > 0 ? low : high) = middle;
      }
      return low;
    }
    return end;
  }

  // r in [0, end] with g(r) = value, where g grows on [0, end]; `end` when value is out of reach.
  // Newton's method, kept inside a shrinking bracket.
  double Inverse(double value, double end) const {
    if (std::isfinite(end) && value >= Value(end)) return end;
    double low = 0;
    double high = std::isfinite(end) ? end : std::max(1.0, value);
    while (Value(high) < value) high *= 2;
    double r = std::clamp(value, low, high);
    for (int i = 0; i < kMaxIterations; ++i) {
      const double error = Value(r) - value;
      (error > 0 ? high : low) = r;
      double next = r - error / Derivative(r);
      if (!(next > low && next < high)) next = 0.5 * (low + high);
      if (std::abs(next - r) < kTolerance) return next;
      r = next;
    }
    return r;
  }
};

RadialPolynomial Radial(const DistortedCamera& camera) {
  const auto& k = camera.coefficients;
  if (camera.model == Distortion::kEquidistant) return {{k[0], k[1], k[2], k[3]}};
  return {{k[0], k[1], 0, 0}};
}

// Where the radial part of the Brown-Conrady model stops growing: the smaller positive root s of
// 1 + 3 k1 s + 5 k2 s^2 = 0, s = r^2.
double RadialTangentialMaxRadius(double k1, double k2) {
  const double a = 5 * k2, b = 3 * k1;
  if (a == 0) return b < 0 ? std::sqrt(-1 / b) : kInfinity;
  const double discriminant = b * b - 4 * a;
  if (discriminant < 0) return kInfinity;
  // q by the numerically stable formula; the roots are q / a and 1 / q.
  const double q = -0.5 * (b + std::copysign(std::sqrt(discriminant), b));
  double smallest = kInfinity;
  for (const double root : {q / a, 1 / q}) {
    if (root > 0) smallest = std::min(smallest, root);
  }
  return std::sqrt(smallest);
}

// Brown-Conrady on the plane z = 1, with its Jacobian.
Eigen::Vector2d DistortRadialTangential(const std::array<double, 4>& k, const Eigen::Vector2d& p,
                                        Eigen::Matrix2d* jacobian) {
  const double x = p.x(), y = p.y(), s = p.squaredNorm();
  const double radial = 1 + s * (k[0] + s * k[1]);
  if (jacobian) {
    const double slope = 2 * k[0] + 4 * k[1] * s;  // d radial / d x = x * slope
    (*jacobian)(0, 0) = radial + x * x * slope + 2 * k[2] * y + 6 * k[3] * x;
    (*jacobian)(0, 1) = x * y * slope + 2 * k[2] * x + 2 * k[3] * y;
    (*jacobian)(1, 0) = (*jacobian)(0, 1);
    (*jacobian)(1, 1) = radial + y * y * slope + 6 * k[2] * y + 2 * k[3] * x;
  }
  return {x * radial + 2 * k[2] * x * y + k[3] * (s + 2 * x * x),
          y * radial + k[2] * (s + 2 * y * y) + 2 * k[3] * x * y};
}

bool UndistortRadialTangential(const DistortedCamera& camera, const Eigen::Vector2d& distorted,
                               Eigen::Vector2d* undistorted) {
  const double max_radius = camera.MaxRadius();
  const double distorted_radius = distorted.norm();
  Eigen::Vector2d p = distorted;
  if (distorted_radius > 0) {
    p *= Radial(camera).Inverse(distorted_radius, max_radius) / distorted_radius;
  }
  for (int i = 0; i < kMaxIterations; ++i) {
    Eigen::Matrix2d jacobian;
    const Eigen::Vector2d error =
        DistortRadialTangential(camera.coefficients, p, &jacobian) - distorted;
    if (!(jacobian.determinant() > 0)) return false;
    const Eigen::Vector2d step = jacobian.inverse() * error;
    p -= step;
    if (step.norm() < kTolerance * (1 + p.norm())) {
      *undistorted = p;
      return p.norm() < max_radius;
    }
  }
  return false;
}

bool UndistortEquidistant(const DistortedCamera& camera, const Eigen::Vector2d& distorted,
                          Eigen::Vector2d* undistorted) {
  const double distorted_angle = distorted.norm();
  if (distorted_angle < 1e-12) {
    *undistorted = distorted;
    return true;
  }
  const RadialPolynomial radial = Radial(camera);
  const double end = radial.GrowsUpTo(kMaxTheta);
  if (distorted_angle >= radial.Value(end)) return false;
  *undistorted = std::tan(radial.Inverse(distorted_angle, end)) / distorted_angle * distorted;
  return true;
}

}  // namespace

Eigen::Vector2d DistortedCamera::Project(const Eigen::Vector3d& point_in_cam) const {
  Eigen::Vector2d p = point_in_cam.hnormalized();
  if (model == Distortion::kRadialTangential) {
    p = DistortRadialTangential(coefficients, p, nullptr);
  } else if (model == Distortion::kEquidistant) {
    const double radius = p.norm();
    if (radius > 1e-12) p *= Radial(*this).Value(std::atan(radius)) / radius;
  }
  return {pinhole.fx * p.x() + pinhole.cx, pinhole.fy * p.y() + pinhole.cy};
}

bool DistortedCamera::Unproject(const Eigen::Vector2d& pixel,
                                Eigen::Vector3d* point_on_plane) const {
  const Eigen::Vector2d distorted = pinhole.Unproject(pixel).head<2>();
  Eigen::Vector2d undistorted = distorted;
  bool ok = true;
  if (model == Distortion::kRadialTangential) {
    ok = UndistortRadialTangential(*this, distorted, &undistorted);
  } else if (model == Distortion::kEquidistant) {
    ok = UndistortEquidistant(*this, distorted, &undistorted);
  }
  if (ok) *point_on_plane = undistorted.homogeneous();
  return ok;
}

double DistortedCamera::MaxRadius() const {
  switch (model) {
    case Distortion::kRadialTangential:
      return RadialTangentialMaxRadius(coefficients[0], coefficients[1]);
    case Distortion::kEquidistant:
      return std::tan(Radial(*this).GrowsUpTo(kMaxTheta));
    case Distortion::kNone:
      break;
  }
  return kInfinity;
}

}  // namespace airslam
