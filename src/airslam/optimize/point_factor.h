// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/cost_function.h>

#include "airslam/geometry/pinhole.h"

namespace airslam {

// A point seen by one keyframe: in the left image and, where right_x >= 0, in the right image too.
struct PointObservation {
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();  // rectified left image
  double right_x = -1;                              // column in the rectified right image
  double sigma = 1;                                 // standard deviation in pixels

  bool has_right() const { return right_x >= 0; }
};

// Point re-projection error (paper, eq. 12; signs: projected minus observed), in units of sigma:
// (u, v) or, for a stereo observation, (u, v, u_right). Parameters: PoseParameter of
// world_from_cam (7), point_in_world (3). Derivatives are with respect to the plain quaternion
// coefficients; the pose block needs a PoseManifold. Derivation: docs/factors.md.
//
// A point at or behind the camera has a constant residual of kBehindResidual and no derivative, so
// that it counts as an outlier instead of stopping the solver.
class PointFactor final : public ceres::CostFunction {
 public:
  static constexpr double kBehindResidual = 100.0;

  PointFactor(const StereoCamera& stereo, const PointObservation& observation);

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  StereoCamera stereo_;
  PointObservation observation_;
};

// The same with a point that is known: one parameter block, the pose (7).
class FixedPointFactor final : public ceres::CostFunction {
 public:
  FixedPointFactor(const StereoCamera& stereo, const PointObservation& observation,
                   const Eigen::Vector3d& point_in_world);

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  PointFactor factor_;
  Eigen::Vector3d point_in_world_;
};

}  // namespace airslam
