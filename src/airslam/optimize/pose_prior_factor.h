// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/sized_cost_function.h>

#include "airslam/geometry/rigid3.h"

namespace airslam {

using Matrix6d = Eigen::Matrix<double, 6, 6>;

// What is known of a pose beforehand. Errors have the order (rotation about the camera's axes in
// radians, position in world in metres).
struct PosePrior {
  Rigid3 world_from_cam;
  Matrix6d weight = Matrix6d::Identity();  // W: W' W is the inverse of the errors' covariance

  PosePrior() = default;
  PosePrior(const Rigid3& pose, double sigma_rotation, double sigma_position);
  // Throws Error when the covariance is not positive definite.
  static PosePrior FromCovariance(const Rigid3& pose, const Matrix6d& covariance);

  // Standard deviations of the direction that is known least.
  double SigmaRotation() const;
  double SigmaPosition() const;
};

// Distance of a pose from its prior, in sigmas: the weight times (twice the vector part of
// prior^-1 * q, which is the rotation vector for the small angles that a prior is about, and the
// difference of positions). Parameters: PoseParameter of world_from_cam (7). Derivation:
// docs/factors.md.
class PosePriorFactor final : public ceres::SizedCostFunction<6, 7> {
 public:
  explicit PosePriorFactor(const PosePrior& prior) : prior_(prior) {}

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  PosePrior prior_;
};

}  // namespace airslam
