// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/manifold.h>
#include <ceres/product_manifold.h>

#include <array>

#include "airslam/geometry/rigid3.h"

namespace airslam {

// A pose as Ceres sees it: (qx, qy, qz, qw, tx, ty, tz) of world_from_cam.
using PoseParameter = std::array<double, 7>;

// Unit quaternion times translation: 6 degrees of freedom (a, t). q <- (sin|a| a / |a|, cos|a|) q:
// a turn by 2 a about the world's axes; t in metres, in the world.
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

// What projecting needs of a pose.
struct CameraView {
  Eigen::Matrix3d cam_from_world;  // rotation
  Eigen::Vector3d centre;          // in world

  CameraView() = default;
  // Of a PoseParameter. The rotation is the polynomial in the quaternion's coefficients.
  explicit CameraView(const double* pose)
      : cam_from_world(Eigen::Map<const Eigen::Quaterniond>(pose).toRotationMatrix().transpose()),
        centre(Eigen::Map<const Eigen::Vector3d>(pose + 4)) {}
};

// Writes a factor's derivatives by the seven numbers of a pose (row-major) that are those by
// PoseManifold's tangent where a change stays on the manifold; other changes count nothing.
template <class ByTangent>
void WriteByPoseParameter(const ByTangent& by_tangent, const double* pose, double* target) {
  const double x = pose[0], y = pose[1], z = pose[2], w = pose[3];
  Eigen::Matrix<double, 3, 4> turn_by_quaternion;  // vec(dq q^-1)
  turn_by_quaternion << w, -z, y, -x, z, w, -x, -y, -y, x, w, -z;
  Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, 7, Eigen::RowMajor>> j(target, by_tangent.rows(),
                                                                          7);
  j.template leftCols<4>() = by_tangent.template leftCols<3>().lazyProduct(turn_by_quaternion);
  j.template rightCols<3>() = by_tangent.template rightCols<3>();
}

}  // namespace airslam
