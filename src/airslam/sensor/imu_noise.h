// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "airslam/sensor/imu.h"

namespace airslam {

// The noise model, with white noise raised to what the readings themselves show: the scatter of
// their second differences, to which smooth motion adds next to nothing. A calibration tells the
// sensor's noise at rest; what motors shake comes on top, and is noise to an integration of
// samples. Fewer than 10 second differences of evenly spaced readings leave the model as it is.
ImuNoise WithMeasuredNoise(const ImuNoise& calibrated, const std::vector<ImuSample>& samples);

}  // namespace airslam
