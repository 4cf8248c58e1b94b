// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/manifold.h>

#include <array>

#include "airslam/geometry/plucker_line.h"

namespace airslam {

// A line as Ceres sees it: the orthonormal representation (qx, qy, qz, qw, w1, w2), with q the unit
// quaternion of U and (w1, w2) of length 1. The line in Plücker coordinates, up to scale, is
// (w1 u1, w2 u2) with u1, u2 the first columns of U.
using LineParameter = std::array<double, 6>;

LineParameter ToParameter(const PluckerLine& line);

// A line that an optimizer has carried to infinity comes back with a moment of 1e9 metres.
PluckerLine LineFromParameter(const LineParameter& parameter);

// SO(3) x SO(2): 6 parameters, 4 degrees of freedom (paper, section V-C, "3D Line Representation";
// Bartoli and Sturm, "Structure-from-motion using lines", CVIU 2005): U <- U Exp(a, b, c),
// W <- W R(d), in radians. a, b and c turn the line about the axes n, v and n x v through the
// world's origin; d changes its distance from there. Derivation: docs/factors.md.
class LineManifold final : public ceres::Manifold {
 public:
  int AmbientSize() const override { return 6; }
  int TangentSize() const override { return 4; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override;
  bool PlusJacobian(const double* x, double* jacobian) const override;  // 6 x 4, row-major
  bool Minus(const double* y, const double* x, double* y_minus_x) const override;
  bool MinusJacobian(const double* x, double* jacobian) const override;  // 4 x 6, row-major
};

}  // namespace airslam
