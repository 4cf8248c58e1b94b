// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>

#include "airslam/geometry/rigid3.h"

namespace airslam {

// A similarity named b_from_a: point_in_b = scale * (rotation * point_in_a) + translation.
// With scale 1 it is a rigid transform.
struct Similarity3 {
  double scale = 1;
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  Eigen::Vector3d operator*(const Eigen::Vector3d& point_in_a) const {
    return scale * (rotation * point_in_a) + translation;
  }

  // The pose of a frame c, given in a, as seen from b: lengths grow by `scale`, axes turn.
  Rigid3 Apply(const Rigid3& a_from_c) const {
    return {rotation * a_from_c.rotation, *this * a_from_c.translation};
  }
};

// b_from_a that minimises the sum of |b_i - b_from_a * a_i|^2 over all pairs of points (Umeyama,
// "Least-squares estimation of transformation parameters between two point patterns", PAMI 1991,
// eq. 40-42). The scale is estimated only when `with_scale`, else it is 1.
//
// Returns nothing when the transform is not determined: fewer than three pairs, or points that
// coincide or lie on one straight line. Both spans must be of the same length.
std::optional<Similarity3> AlignPoints(std::span<const Eigen::Vector3d> points_in_a,
                                       std::span<const Eigen::Vector3d> points_in_b,
                                       bool with_scale);

}  // namespace airslam
