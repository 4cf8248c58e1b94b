// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/sized_cost_function.h>
#include <ceres/sphere_manifold.h>

#include <array>

#include "airslam/geometry/rigid3.h"
#include "airslam/sensor/imu_preintegration.h"

namespace airslam {

// Biases as Ceres sees them: gyroscope (rad/s), accelerometer (m/s^2).
using BiasParameter = std::array<double, 6>;

// Gravity in world keeps its length: 2 degrees of freedom.
using GravityManifold = ceres::SphereManifold<3>;

inline BiasParameter ToParameter(const ImuBias& bias) {
  const auto& g = bias.gyroscope;
  const auto& a = bias.accelerometer;
  return {g.x(), g.y(), g.z(), a.x(), a.y(), a.z()};
}

inline ImuBias FromParameter(const BiasParameter& p) {
  return {{p[0], p[1], p[2]}, {p[3], p[4], p[5]}};
}

// What the IMU says of two states i, j (paper, section V-E.3, eq. of r_R, r_v, r_p), in sigmas:
// (rotation, velocity, position), weighted by the square root of the inverse covariance.
// Parameters: PoseParameter i of world_from_cam (7), velocity i of the *body* in world (3),
// BiasParameter i (6), pose j (7), velocity j (3), gravity in world (3: GravityManifold, or
// constant). The camera is the one of PointFactor (rectified left); its place on the body is
// constant. The pose blocks need a PoseManifold: derivatives are those along it, times the
// quaternion's. Derivation: docs/factors.md.
class InertialFactor final : public ceres::SizedCostFunction<9, 7, 3, 6, 7, 3, 3> {
 public:
  // Floors of the standard deviations (rad, m/s, m): what the integration itself gets wrong, and
  // so that noise densities of zero can be used.
  static constexpr double kMinSigmaRotation = 1e-6;
  static constexpr double kMinSigmaVelocity = 1e-5;
  static constexpr double kMinSigmaPosition = 1e-6;

  // body_from_cam: the rectified camera's. Throws Error when the preintegration spans no time.
  // Keeps what it needs: the preintegration may go.
  InertialFactor(const ImuPreintegration& preintegration, const Rigid3& body_from_cam);

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  struct Terms;
  Terms ComputeTerms(double const* const* parameters) const;
  void PoseJacobian(const Terms& terms, const double* pose, bool second, double* jacobian) const;

  double duration_;
  ImuDelta delta_;
  ImuBias bias_;
  Matrix96d by_bias_;
  Matrix9d weight_;  // inverse of the covariance's Cholesky factor
  Rigid3 cam_from_body_;
};

}  // namespace airslam
