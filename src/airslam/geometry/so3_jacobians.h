// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

namespace airslam {

// Right Jacobian of SO(3) at a rotation vector in radians (Forster et al. 2017, eq. 8):
// Exp(v + d) = Exp(v) Exp(RightJacobian(v) d) to first order in d.
Eigen::Matrix3d RightJacobian(const Eigen::Vector3d& rotation_vector);

// Its inverse (eq. 9): Log(Exp(v) Exp(d)) = v + RightJacobianInverse(v) d to first order in d.
// For rotations of less than 2 pi.
Eigen::Matrix3d RightJacobianInverse(const Eigen::Vector3d& rotation_vector);

}  // namespace airslam
