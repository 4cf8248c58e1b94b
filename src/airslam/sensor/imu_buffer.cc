// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/sensor/imu_buffer.h"

#include <algorithm>
#include <cmath>

#include "airslam/common/error.h"

namespace airslam {
namespace {

std::int64_t ToNs(double seconds) { return std::llround(seconds * 1e9); }

// The first reading at or after a time.
std::vector<ImuSample>::const_iterator FirstFrom(const std::vector<ImuSample>& samples,
                                                 std::int64_t time_ns) {
  return std::lower_bound(samples.begin(), samples.end(), time_ns,
                          [](const ImuSample& s, std::int64_t t) { return s.timestamp_ns < t; });
}

}  // namespace

void ImuBufferOptions::Validate() const {
  if (!(std::abs(time_offset) < 10)) {
    Fail("time_offset is {} s: expected less than 10 s either way", time_offset);
  }
  if (!(max_gap > 0)) Fail("max_gap is {} s: expected more than 0", max_gap);
  if (!(max_angular_velocity > 0)) {
    Fail("max_angular_velocity is {} rad/s: expected more than 0", max_angular_velocity);
  }
  if (!(max_acceleration > 0)) {
    Fail("max_acceleration is {} m/s^2: expected more than 0", max_acceleration);
  }
}

ImuSample Interpolate(const ImuSample& before, const ImuSample& after, std::int64_t time_ns) {
  const double part = static_cast<double>(time_ns - before.timestamp_ns) /
                      static_cast<double>(after.timestamp_ns - before.timestamp_ns);
  ImuSample sample;
  sample.timestamp_ns = time_ns;
  sample.angular_velocity =
      before.angular_velocity + part * (after.angular_velocity - before.angular_velocity);
  sample.acceleration = before.acceleration + part * (after.acceleration - before.acceleration);
  return sample;
}

ImuBuffer::ImuBuffer(const std::vector<ImuSample>& samples, const ImuBufferOptions& options)
    : options_(options) {
  options_.Validate();
  samples_.reserve(samples.size());
  Append(samples);
}

void ImuBuffer::Append(const std::vector<ImuSample>& samples) {
  const std::int64_t offset_ns = ToNs(options_.time_offset);
  for (ImuSample sample : samples) {
    if (!sample.angular_velocity.allFinite() || !sample.acceleration.allFinite()) {
      Fail(
          "the IMU reading at {} ns is not finite: angular velocity ({}, {}, {}), acceleration "
          "({}, {}, {})",
          sample.timestamp_ns, sample.angular_velocity.x(), sample.angular_velocity.y(),
          sample.angular_velocity.z(), sample.acceleration.x(), sample.acceleration.y(),
          sample.acceleration.z());
    }
    sample.timestamp_ns -= offset_ns;
    if (!samples_.empty() && sample.timestamp_ns <= samples_.back().timestamp_ns) {
      ++dropped_;
    } else {
      samples_.push_back(sample);
    }
  }
}

ImuBuffer ImuBuffer::WithTimeOffset(double time_offset) const {
  ImuBuffer moved;
  moved.options_ = options_;
  moved.options_.time_offset = time_offset;
  moved.options_.Validate();
  moved.dropped_ = dropped_;
  moved.samples_ = samples_;
  const std::int64_t shift_ns = ToNs(options_.time_offset) - ToNs(time_offset);
  for (ImuSample& sample : moved.samples_) sample.timestamp_ns += shift_ns;
  return moved;
}

ImuSample ImuBuffer::At(std::int64_t time_ns) const {
  const auto after = FirstFrom(samples_, time_ns);
  if (after != samples_.end() && (after->timestamp_ns == time_ns || after != samples_.begin())) {
    return after->timestamp_ns == time_ns ? *after : Interpolate(*(after - 1), *after, time_ns);
  }
  ImuSample nearest = after == samples_.end() ? samples_.back() : *after;
  nearest.timestamp_ns = time_ns;
  return nearest;
}

ImuInterval ImuBuffer::Between(std::int64_t begin_ns, std::int64_t end_ns) const {
  ImuInterval interval;
  if (samples_.empty() || begin_ns >= end_ns) return interval;
  // From the last reading at or before the begin to the first at or after the end.
  auto first = FirstFrom(samples_, begin_ns);
  if (first != samples_.begin() && (first == samples_.end() || first->timestamp_ns > begin_ns)) {
    --first;
  }
  auto last = FirstFrom(samples_, end_ns);
  if (last == samples_.end()) --last;

  std::int64_t uncovered_ns = 0;
  const auto add_gap = [&](std::int64_t from_ns, std::int64_t to_ns) {
    const double gap = 1e-9 * static_cast<double>(to_ns - from_ns);
    interval.largest_gap = std::max(interval.largest_gap, gap);
    if (gap <= options_.max_gap) return;
    uncovered_ns +=
        std::max<std::int64_t>(0, std::min(to_ns, end_ns) - std::max(from_ns, begin_ns));
  };
  if (first->timestamp_ns > begin_ns) add_gap(begin_ns, std::min(first->timestamp_ns, end_ns));
  if (last->timestamp_ns < end_ns) add_gap(std::max(last->timestamp_ns, begin_ns), end_ns);

  interval.samples.push_back(At(begin_ns));
  for (auto sample = first; sample <= last; ++sample) {
    if (sample != first) add_gap((sample - 1)->timestamp_ns, sample->timestamp_ns);
    if (sample->angular_velocity.cwiseAbs().maxCoeff() >= options_.max_angular_velocity ||
        sample->acceleration.cwiseAbs().maxCoeff() >= options_.max_acceleration) {
      ++interval.saturated;
    }
    if (sample->timestamp_ns > begin_ns && sample->timestamp_ns < end_ns) {
      interval.samples.push_back(*sample);
    }
  }
  interval.samples.push_back(At(end_ns));
  interval.coverage =
      1 - static_cast<double>(uncovered_ns) / static_cast<double>(end_ns - begin_ns);
  return interval;
}

}  // namespace airslam
