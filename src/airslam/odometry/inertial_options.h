// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace airslam {

// How the IMU is used.
struct InertialOptions {
  bool enabled = true;
  double max_gap = 0.05;
  double max_angular_velocity = 34.9;
  double max_acceleration = 156.9;
  double max_blackout = 5.0;
  double max_position_sigma = 0.5;

  template <class V>
  void Visit(V& v) {
    v.Field("enabled", enabled, "False: as if there were no IMU (`airslam map --no-imu`).");
    v.Field("max_gap", max_gap, {0.001, 10, "s"},
            "Between two readings: what lies between them counts as missing where it is longer.");
    v.Field("max_angular_velocity", max_angular_velocity, {0.1, 1e6, "rad/s"},
            "A reading at or above it has reached the end of its scale (2000 degrees/s).");
    v.Field("max_acceleration", max_acceleration, {1, 1e6, "m/s^2"},
            "A reading at or above it has reached the end of its scale (16 g).");
    v.Field("max_blackout", max_blackout, {0, 60, "s"},
            "The IMU alone may carry the pose for so long.");
    v.Field(
        "max_position_sigma", max_position_sigma, {0.001, 1000, "m"},
        "The IMU alone may carry the pose while the position's standard deviation is below this.");
  }
};

}  // namespace airslam
