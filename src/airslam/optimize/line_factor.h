// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/cost_function.h>

#include "airslam/optimize/line_manifold.h"
#include "airslam/optimize/line_residual.h"

namespace airslam {

// LineResidual as a factor of Ceres, with 2 or 4 residuals. Parameters: PoseParameter of
// world_from_cam of the left camera (7), LineParameter of the line in the world (6). The blocks
// need a PoseManifold and a LineManifold: derivatives are those along them, times those of the
// parameters. Derivation: docs/factors/lines.md.
class LineFactor final : public ceres::CostFunction {
 public:
  static constexpr double kNoImageResidual = LineResidual::kNoImageResidual;

  LineFactor(const StereoCamera& stereo, const LineObservation& observation);

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  StereoCamera stereo_;
  LineObservation observation_;
};

}  // namespace airslam
