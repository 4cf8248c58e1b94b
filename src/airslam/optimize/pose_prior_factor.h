// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/sized_cost_function.h>

#include "airslam/geometry/rigid3.h"

namespace airslam {

// What is known of a pose beforehand, with standard deviations of its rotation (radians, about the
// camera's axes) and its position (metres).
struct PosePrior {
  Rigid3 world_from_cam;
  double sigma_rotation = 1;
  double sigma_position = 1;
};

// Distance of a pose from its prior, in sigmas: twice the vector part of prior^-1 * q (the rotation
// vector, for the small angles that a prior is about), then the difference of positions. Parameters:
// PoseParameter of world_from_cam (7). Derivation: docs/factors.md.
class PosePriorFactor final : public ceres::SizedCostFunction<6, 7> {
 public:
  explicit PosePriorFactor(const PosePrior& prior) : prior_(prior) {}

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  PosePrior prior_;
};

}  // namespace airslam
