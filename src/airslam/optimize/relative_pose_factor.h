// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/sized_cost_function.h>

#include "airslam/geometry/rigid3.h"
#include "airslam/optimize/pose_prior_factor.h"

namespace airslam {

// What is known of one pose relative to another: an edge of a pose graph, or a loop.
struct RelativePose {
  int from = -1, to = -1;  // positions in the list of poses of the problem
  Rigid3 from_from_to;     // measured: pose(from)^-1 * pose(to)
  // Of the residual's order: rotation (rad), position (m, in `from`'s frame turned).
  Matrix6d covariance = Matrix6d::Identity();
};

// Residual Log(T_measured^-1 T_from^-1 T_to) in SE(3) (paper, eq. 17), order
// (rotation, position), in sigmas: times the inverse of the covariance's Cholesky factor.
// Parameters: PoseParameter of world_from_cam of both (7, 7), with a PoseManifold. Derivatives are
// those along it, times the quaternion's. Derivation: docs/factors.md.
class RelativePoseFactor final : public ceres::SizedCostFunction<6, 7, 7> {
 public:
  // Throws Error when the covariance is not positive definite.
  explicit RelativePoseFactor(const RelativePose& measured);

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  Rigid3 to_from_from_;  // measured, the inverse
  Matrix6d weight_;
};

}  // namespace airslam
