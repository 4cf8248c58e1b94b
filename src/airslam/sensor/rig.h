// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <optional>
#include <string>

#include "airslam/geometry/rigid3.h"
#include "airslam/sensor/distorted_camera.h"
#include "airslam/sensor/imu.h"

namespace airslam {

// A *raw* camera of the rig, before rectification.
struct RigCamera {
  DistortedCamera camera;
  Rigid3 body_from_cam;  // raw camera frame to body
};

// The calibration of a stereo rig. The body is the IMU frame if the calibration has one; else it is
// the left raw camera, or for an EuRoC folder without imu0 whatever frame its T_BS refer to.
struct StereoRig {
  RigCamera left;
  RigCamera right;
  std::optional<ImuNoise> imu;
  // KITTI's images are rectified already and share one camera matrix.
  bool already_rectified = false;
  double rate_hz = 0;  // of the images; 0 when the calibration does not say
  // time of the IMU = time of the image + this, in seconds (Kalibr's timeshift_cam_imu of cam0).
  double imu_time_offset = 0;

  // Distance between the two optical centres in metres.
  double Baseline() const;
};

}  // namespace airslam
