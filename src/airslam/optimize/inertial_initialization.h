// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "airslam/geometry/rigid3.h"
#include "airslam/sensor/imu.h"
#include "airslam/sensor/imu_buffer.h"
#include "airslam/sensor/imu_preintegration.h"

namespace airslam {

struct InertialInitializationOptions {
  int min_frames = 6;         // of a moving start
  double min_duration = 1.5;  // seconds, of a moving start
  double min_rest = 0.5;      // seconds, of a start at rest
  double gravity = 9.81;      // m/s^2

  // Standard deviations of what is known beforehand: of a pose relative to its neighbours (rad, m),
  // and of the accelerometer's bias about 0 (m/s^2).
  double sigma_rotation = 5e-4;
  double sigma_position = 3e-3;
  double sigma_accelerometer_bias = 0.2;

  // At rest: no pose leaves the first by more than these (rad, m) and the readings scatter by less
  // (standard deviation of each axis, rad/s and m/s^2). A drone whose motors idle on the ground
  // shakes: 0.1 rad/s and 1.3 m/s^2 at the start of EuRoC's V1_01.
  double rest_rotation = 0.01;
  double rest_position = 0.02;
  double rest_gyroscope = 0.15;
  double rest_accelerometer = 1.5;

  // Refused when the estimate's own standard deviations are above these (rad, rad/s, m/s^2): the
  // motion did not tell gravity from the bias.
  double max_gravity_sigma = 0.005;
  double max_gyroscope_bias_sigma = 2e-3;
  double max_accelerometer_bias_sigma = 0.06;
  // Refused when the residuals' root mean square, in sigmas, is above this,
  double max_residual = 2.5;
  // or gravity without its length given comes out further from it than this (m/s^2),
  double max_gravity_error = 1.0;
  // or the time offset of camera and IMU is known well enough and is above this (seconds).
  double max_time_offset = 0.005;
  double time_offset_search = 0.06;  // seconds to both sides
  double time_offset_step = 0.005;   // seconds

  // Throws Error that names the field.
  void Validate() const;
};

// Where a frame was, by vision alone.
struct InertialFrame {
  std::int64_t timestamp_ns = 0;  // image time
  Rigid3 world_from_cam;          // rectified left camera, in metres
};

enum class InertialRefusal {
  kNone,
  kTooShort,      // too few frames or too little time
  kImuGap,        // readings are missing
  kSaturated,     // readings at the end of the scale
  kTimeOffset,    // see InertialInitialization::time_offset: correct the buffer, and try again
  kNotExcited,    // the motion does not tell gravity and the accelerometer's bias apart
  kInconsistent,  // poses and readings contradict each other beyond their noise
};
// A word for reports: "too short", "IMU gap", ...
std::string_view ToString(InertialRefusal refusal);

struct InertialInitialization {
  InertialRefusal refusal = InertialRefusal::kNone;
  std::string reason;  // one sentence with the figures; empty when initialised
  bool at_rest = false;

  // Valid when initialised. World is that of the frames' poses.
  ImuBias bias;
  Eigen::Vector3d gravity_in_world = Eigen::Vector3d::Zero();  // m/s^2, points down
  std::vector<Eigen::Vector3d> velocities_in_world;            // of the body, one a frame, m/s

  // Standard deviations of the estimate (the worst axis), when it came that far: else 0.
  double gravity_sigma = 0;             // rad
  double gyroscope_bias_sigma = 0;      // rad/s
  double accelerometer_bias_sigma = 0;  // m/s^2
  double residual = 0;                  // root mean square in sigmas

  // Error of the buffer's time offset: its options().time_offset + this is the better one.
  double time_offset = 0;        // seconds
  double time_offset_sigma = 0;  // seconds; 0: unknown (at rest, or too little turning)

  bool ok() const { return refusal == InertialRefusal::kNone; }
};

// Gravity, biases and velocities from the poses of frames in order of time and the readings between
// them; the scale is known (stereo). As in the paper's references for it (VINS, ORB-SLAM3): the
// gyroscope's bias from rotations; gravity and velocities linearly; gravity of known length with
// the accelerometer's bias; all together with poses that may move within their noise. At rest (two
// frames suffice) gravity is the mean acceleration's direction, and the gyroscope's bias its mean;
// then the accelerometer's bias across gravity is unknown, as gravity_sigma says.
//
// Never throws for bad data: refuses with a reason. Throws Error for bad options. Deterministic.
InertialInitialization InitializeInertial(const InertialInitializationOptions& options,
                                          const std::vector<InertialFrame>& frames,
                                          const ImuBuffer& imu, const ImuNoise& noise,
                                          const Rigid3& body_from_cam);

}  // namespace airslam
