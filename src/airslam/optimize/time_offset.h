// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include <vector>

#include "airslam/geometry/rigid3.h"
#include "airslam/optimize/inertial_initialization.h"
#include "airslam/sensor/imu_buffer.h"

namespace airslam {

// The error of the buffer's time offset alone: the shift that makes the gyroscope's turns between
// frames agree best with those of the poses, within +- search seconds, and its standard deviation
// (0 when the minimum lies at the end of the search or is flat). The biases are free.
struct TimeOffsetEstimate {
  double offset = 0;  // seconds, to be added to the buffer's time_offset
  double sigma = 0;   // seconds; 0: unknown
};
TimeOffsetEstimate EstimateTimeOffset(const InertialInitializationOptions& options,
                                      const std::vector<InertialFrame>& frames,
                                      const ImuBuffer& imu, const Eigen::Vector3d& gyroscope_bias,
                                      const Rigid3& body_from_cam);

}  // namespace airslam
