// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/cost_function.h>

#include "airslam/optimize/point_residual.h"

namespace airslam {

// PointResidual as a factor of Ceres: (u, v) or, for a stereo observation, (u, v, u_right).
// Parameters: PoseParameter of world_from_cam (7), point_in_world (3). The pose block needs a
// PoseManifold: derivatives are those along it, times the quaternion's. Derivation:
// docs/factors/points.md.
class PointFactor final : public ceres::CostFunction {
 public:
  static constexpr double kBehindResidual = PointResidual::kBehindResidual;

  PointFactor(const StereoCamera& stereo, const PointObservation& observation);

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  StereoCamera stereo_;
  PointObservation observation_;
};

}  // namespace airslam
