// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/sized_cost_function.h>

#include "airslam/sensor/imu.h"

namespace airslam {

// Walk of the biases from one state to the next (paper, section V-E.3, r_b), in sigmas: the
// difference over random walk * sqrt(duration). Parameters: BiasParameter i (6), j (6).
class BiasWalkFactor final : public ceres::SizedCostFunction<6, 6, 6> {
 public:
  // Floors of the standard deviations (rad/s, m/s^2), so that biases that do not walk can be used.
  static constexpr double kMinSigmaGyroscope = 1e-7;
  static constexpr double kMinSigmaAccelerometer = 1e-6;

  // duration in seconds.
  BiasWalkFactor(const ImuNoise& noise, double duration);

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  double gyroscope_weight_, accelerometer_weight_;
};

}  // namespace airslam
