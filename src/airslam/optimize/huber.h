// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <limits>

namespace airslam {

// Huber's loss rho of a squared residual s: s up to bound^2, and growing like its root beyond.
struct Huber {
  double bound = std::numeric_limits<double>::infinity();  // infinite: the plain square

  double Cost(double squares) const {
    return squares <= bound * bound ? squares : 2 * bound * std::sqrt(squares) - bound * bound;
  }
  // rho'(s), by which the squares are weighed in the normal equations. (Ceres does the same: its
  // correction of second order is for losses with rho'' > 0 only.)
  double Weight(double squares) const {
    return squares <= bound * bound ? 1 : bound / std::sqrt(squares);
  }
};

}  // namespace airslam
