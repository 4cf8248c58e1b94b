// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include <cstdint>
#include <string>
#include <vector>

#include "airslam/sensor/imu_preintegration.h"

namespace airslam {

// How the IMU of one component was initialised, with its latest refinement.
struct InertialStart {
  int component = -1;
  std::int64_t timestamp_ns = 0;  // of the frame after which the IMU was used first
  double seconds = 0;             // from the component's first frame to that one
  bool at_rest = false;           // the latest estimate is of a body at rest
  double span = 0;                // seconds of frames that the latest estimate is made of
  int refinements = 0;
  Eigen::Vector3d gravity_in_world = Eigen::Vector3d::Zero();  // m/s^2, before the final turn
  ImuBias bias;                                                // of the latest estimate
  // Standard deviations of the latest estimate: rad, rad/s, m/s^2.
  double gravity_sigma = 0, gyroscope_bias_sigma = 0, accelerometer_bias_sigma = 0;
};

// What became of the IMU in a run.
struct InertialSummary {
  struct Gap {
    std::int64_t begin_ns = 0, end_ns = 0;  // frames between which readings are missing
  };
  // "used"; or, in a word, why not: "off", "no calibration", "no readings", or the refusal of the
  // last attempt to initialise ("too short", "not excited", ...).
  std::string state = "off";
  std::string reason;  // a sentence where it was not used
  int readings = 0;
  int dropped = 0;         // readings that repeated a time or went back
  double time_offset = 0;  // seconds: time of the IMU = time of the image + this
  double calibrated_time_offset = 0;
  std::vector<InertialStart> starts;  // one a component that was initialised
  std::vector<Gap> gaps;              // after initialisation
  ImuBias final_bias;                 // at the last frame, when used
};

}  // namespace airslam
