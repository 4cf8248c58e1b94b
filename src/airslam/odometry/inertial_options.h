// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace airslam {

// How the IMU is used.
struct InertialOptions {
  // False: as if there were no IMU (`airslam map --no-imu`).
  bool enabled = true;
  // Seconds between two readings beyond which the stretch between them counts as missing, > 0.
  double max_gap = 0.05;
  // rad/s, > 0: a reading at or above it has reached the end of its scale (2000 degrees/s).
  double max_angular_velocity = 34.9;
  // m/s^2, > 0: likewise (16 g).
  double max_acceleration = 156.9;
  // Seconds for which the IMU alone may carry the pose, in [0, 60].
  double max_blackout = 5.0;
  // Metres: and as long as the position's standard deviation is below this, > 0.
  double max_position_sigma = 0.5;

  template <class V>
  void Visit(V& v) {
    v.Field("enabled", enabled);
    v.Field("max_gap", max_gap);
    v.Field("max_angular_velocity", max_angular_velocity);
    v.Field("max_acceleration", max_acceleration);
    v.Field("max_blackout", max_blackout);
    v.Field("max_position_sigma", max_position_sigma);
  }
};

}  // namespace airslam
