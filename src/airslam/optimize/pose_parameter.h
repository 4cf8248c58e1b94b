// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/manifold.h>
#include <ceres/product_manifold.h>

#include <array>

#include "airslam/geometry/rigid3.h"

namespace airslam {

// A pose as Ceres sees it: (qx, qy, qz, qw, tx, ty, tz) of world_from_cam.
using PoseParameter = std::array<double, 7>;

// Unit quaternion times translation: 6 degrees of freedom.
using PoseManifold =
    ceres::ProductManifold<ceres::EigenQuaternionManifold, ceres::EuclideanManifold<3>>;

inline PoseParameter ToParameter(const Rigid3& pose) {
  const auto& q = pose.rotation;
  const auto& t = pose.translation;
  return {q.x(), q.y(), q.z(), q.w(), t.x(), t.y(), t.z()};
}

inline Rigid3 FromParameter(const PoseParameter& p) {
  return {Eigen::Quaterniond(p[3], p[0], p[1], p[2]), Eigen::Vector3d(p[4], p[5], p[6])};
}

}  // namespace airslam
