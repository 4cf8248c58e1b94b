// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <limits>
#include <vector>

#include "airslam/sensor/imu.h"

namespace airslam {

struct ImuBufferOptions {
  // Seconds: time of the IMU = time of the image + this (StereoRig::imu_time_offset).
  double time_offset = 0;
  // Seconds between two readings beyond which the stretch between them counts as not covered.
  double max_gap = 0.05;
  // A reading with a coordinate at or above these has reached the end of its scale.
  double max_angular_velocity = std::numeric_limits<double>::infinity();  // rad/s
  double max_acceleration = std::numeric_limits<double>::infinity();      // m/s^2

  // Throws Error that names the field.
  void Validate() const;
};

// The readings between two times, in *image* time.
struct ImuInterval {
  // The first at the begin and the last at the end exactly, both interpolated between the
  // neighbouring readings (the nearest reading where there is none beyond). Empty when the interval
  // holds no time or the buffer no reading.
  std::vector<ImuSample> samples;
  double largest_gap = 0;  // seconds between readings that the interval touches, or missing at ends
  double coverage = 0;     // part of the interval without gaps above max_gap, 0 to 1
  int saturated = 0;       // readings at the end of the scale

  bool complete() const { return !samples.empty() && coverage >= 1; }
};

// The readings of a sequence in order of time. The times asked for and returned are those of the
// images.
class ImuBuffer {
 public:
  // Drops readings whose time repeats or goes back. Throws Error for a reading that is not finite,
  // or bad options.
  ImuBuffer(const std::vector<ImuSample>& samples, const ImuBufferOptions& options);

  // Readings that follow, in the IMU's own time. As the constructor.
  void Append(const std::vector<ImuSample>& samples);

  ImuInterval Between(std::int64_t begin_ns, std::int64_t end_ns) const;

  // In image time.
  const std::vector<ImuSample>& samples() const { return samples_; }
  const ImuBufferOptions& options() const { return options_; }
  int dropped() const { return dropped_; }  // readings that repeated a time or went back

  // The same readings moved to another offset (not added to the present one).
  ImuBuffer WithTimeOffset(double time_offset) const;

 private:
  ImuBuffer() = default;
  ImuSample At(std::int64_t time_ns) const;

  std::vector<ImuSample> samples_;
  ImuBufferOptions options_;
  int dropped_ = 0;
};

// Linear between two readings of different times.
ImuSample Interpolate(const ImuSample& before, const ImuSample& after, std::int64_t time_ns);

}  // namespace airslam
