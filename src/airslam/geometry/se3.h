// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include "airslam/geometry/rigid3.h"

namespace airslam {

using Vector6d = Eigen::Matrix<double, 6, 1>;

// Logarithm of SE(3): (rotation vector phi in radians, J_l^-1(phi) t in metres), with the left
// Jacobian of SO(3) (Barfoot, "State Estimation for Robotics", section 7.1). For rotations of less
// than pi. `by_error`, if asked for: its 6 x 6 derivative by (a turn d of the rotation from the
// right, R Exp(d); the translation t).
Vector6d LogSE3(const Rigid3& transform, Eigen::Matrix<double, 6, 6>* by_error = nullptr);

}  // namespace airslam
