// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

namespace airslam {

// Marquardt's damping D of the normal equations, (H + D) x = g with H = J'J and g = -J'r, and how
// the region in which they are trusted grows and shrinks: the rules and constants of Ceres.
class Damping {
 public:
  // The diagonal of H, clamped, over the radius.
  template <class Diagonal>
  auto Of(const Diagonal& diagonal) const {
    return diagonal.cwiseMax(kMinDiagonal).cwiseMin(kMaxDiagonal) / radius_;
  }

  // By how much the step x lowers the model's cost, g'x - x'Hx / 2, of which this is one unknown's
  // share: (g + D x)'x / 2.
  template <class Vector>
  static double Decrease(const Vector& x, const Vector& gradient, const Vector& damping) {
    return 0.5 * x.dot(gradient + damping.cwiseProduct(x));
  }

  // After a step: the decrease of the true cost over that of the model. Returns whether the step is
  // to be taken.
  bool Judge(double quality) {
    if (!(quality > kMinQuality)) {
      radius_ /= shrink_;
      shrink_ *= 2;
      return false;
    }
    const double excess = 2 * quality - 1;
    radius_ = std::min(kMaxRadius, radius_ / std::max(1.0 / 3, 1 - excess * excess * excess));
    shrink_ = 2;
    return true;
  }

 private:
  static constexpr double kMinDiagonal = 1e-6, kMaxDiagonal = 1e32;
  static constexpr double kMinQuality = 1e-3;
  static constexpr double kMaxRadius = 1e16;
  double radius_ = 1e4;
  double shrink_ = 2;
};

}  // namespace airslam
