// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include <cstdint>

namespace airslam {

// One reading in the IMU (body) frame.
struct ImuSample {
  std::int64_t timestamp_ns = 0;
  Eigen::Vector3d angular_velocity = Eigen::Vector3d::Zero();  // rad/s
  Eigen::Vector3d acceleration = Eigen::Vector3d::Zero();      // m/s^2, specific force
};

// Continuous-time noise model, in the units of EuRoC's and Kalibr's files.
struct ImuNoise {
  double gyroscope_noise_density = 0;      // rad / s / sqrt(Hz)
  double gyroscope_random_walk = 0;        // rad / s^2 / sqrt(Hz)
  double accelerometer_noise_density = 0;  // m / s^2 / sqrt(Hz)
  double accelerometer_random_walk = 0;    // m / s^3 / sqrt(Hz)
  double rate_hz = 0;
};

}  // namespace airslam
