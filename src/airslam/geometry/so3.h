// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace airslam {

// [v]x, so that Skew(v) * w = v x w.
Eigen::Matrix3d Skew(const Eigen::Vector3d& v);

// Exponential map of SO(3): rotation vector in radians to unit quaternion.
Eigen::Quaterniond ExpSO3(const Eigen::Vector3d& rotation_vector);

// Logarithm of SO(3): the rotation vector of smallest angle, in [0, pi].
Eigen::Vector3d LogSO3(const Eigen::Quaterniond& rotation);

}  // namespace airslam
