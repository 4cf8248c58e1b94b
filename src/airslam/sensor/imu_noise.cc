// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/sensor/imu_noise.h"

#include <algorithm>
#include <cmath>

namespace airslam {

ImuNoise WithMeasuredNoise(const ImuNoise& calibrated, const std::vector<ImuSample>& samples) {
  constexpr int kMinDifferences = 10;
  constexpr double kEven = 0.2;  // relative difference of two steps that still count as even
  double gyroscope = 0, accelerometer = 0, seconds = 0;
  int differences = 0;
  for (std::size_t k = 2; k < samples.size(); ++k) {
    const ImuSample &a = samples[k - 2], &b = samples[k - 1], &c = samples[k];
    const double first = 1e-9 * static_cast<double>(b.timestamp_ns - a.timestamp_ns);
    const double second = 1e-9 * static_cast<double>(c.timestamp_ns - b.timestamp_ns);
    if (!(std::abs(second - first) <= kEven * first)) continue;
    gyroscope += (a.angular_velocity - 2 * b.angular_velocity + c.angular_velocity).squaredNorm();
    accelerometer += (a.acceleration - 2 * b.acceleration + c.acceleration).squaredNorm();
    seconds += first;
    ++differences;
  }
  ImuNoise noise = calibrated;
  if (differences < kMinDifferences) return noise;
  // A second difference has 6 times the variance of a reading; three axes; density^2 = variance dt.
  const double factor = seconds / differences / (18.0 * differences);
  noise.gyroscope_noise_density =
      std::max(noise.gyroscope_noise_density, std::sqrt(gyroscope * factor));
  noise.accelerometer_noise_density =
      std::max(noise.accelerometer_noise_density, std::sqrt(accelerometer * factor));
  return noise;
}

}  // namespace airslam
