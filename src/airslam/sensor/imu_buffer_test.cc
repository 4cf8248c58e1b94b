// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/sensor/imu_buffer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "airslam/common/error.h"

namespace airslam {
namespace {

using ::testing::HasSubstr;

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kStart = 1'700'000'000'000'000'000;  // a double would round it

// A reading whose values tell its time: 1 rad/s and 2 m/s^2 a second.
ImuSample Reading(std::int64_t ms) {
  const double t = 1e-3 * static_cast<double>(ms);
  return {kStart + ms * kMs, Eigen::Vector3d::Constant(t), Eigen::Vector3d::Constant(2 * t)};
}

std::vector<ImuSample> Readings(const std::vector<std::int64_t>& times_ms) {
  std::vector<ImuSample> samples;
  for (const std::int64_t ms : times_ms) samples.push_back(Reading(ms));
  return samples;
}

TEST(ImuBuffer, InterpolatesTheEnds) {
  const ImuBuffer buffer(Readings({0, 5, 10, 15, 20}), {});
  const ImuInterval interval = buffer.Between(kStart + 3 * kMs, kStart + 16 * kMs);
  ASSERT_EQ(interval.samples.size(), 5u);  // 3, 5, 10, 15, 16 ms
  EXPECT_EQ(interval.samples.front().timestamp_ns, kStart + 3 * kMs);
  EXPECT_NEAR(interval.samples.front().angular_velocity.x(), 0.003, 1e-12);
  EXPECT_EQ(interval.samples.back().timestamp_ns, kStart + 16 * kMs);
  EXPECT_NEAR(interval.samples.back().acceleration.z(), 0.032, 1e-12);
  EXPECT_NEAR(interval.largest_gap, 0.005, 1e-12);
  EXPECT_EQ(interval.coverage, 1);
  EXPECT_TRUE(interval.complete());
}

TEST(ImuBuffer, TakesReadingsAtTheEndsAsTheyAre) {
  const ImuBuffer buffer(Readings({0, 5, 10}), {});
  const ImuInterval interval = buffer.Between(kStart, kStart + 10 * kMs);
  ASSERT_EQ(interval.samples.size(), 3u);
  EXPECT_EQ(interval.samples[2].angular_velocity, Reading(10).angular_velocity);
  EXPECT_TRUE(interval.complete());
}

TEST(ImuBuffer, WorksBetweenTwoReadings) {
  const ImuBuffer buffer(Readings({0, 5}), {});
  const ImuInterval interval = buffer.Between(kStart + 1 * kMs, kStart + 2 * kMs);
  ASSERT_EQ(interval.samples.size(), 2u);
  EXPECT_NEAR(interval.samples[1].angular_velocity.x(), 0.002, 1e-12);
  EXPECT_TRUE(interval.complete());
}

TEST(ImuBuffer, ReportsAGap) {
  const ImuBuffer buffer(Readings({0, 10, 20, 90, 100}), {});
  const ImuInterval interval = buffer.Between(kStart, kStart + 100 * kMs);
  EXPECT_NEAR(interval.largest_gap, 0.07, 1e-12);
  EXPECT_NEAR(interval.coverage, 0.3, 1e-12);
  EXPECT_FALSE(interval.complete());
  // The part of the gap inside the interval.
  EXPECT_NEAR(buffer.Between(kStart, kStart + 40 * kMs).coverage, 0.5, 1e-12);
  EXPECT_TRUE(buffer.Between(kStart + 90 * kMs, kStart + 100 * kMs).complete());
}

TEST(ImuBuffer, HoldsTheNearestReadingBeyondItsEnds) {
  const ImuBuffer buffer(Readings({0, 10, 20}), {});
  const ImuInterval after = buffer.Between(kStart + 10 * kMs, kStart + 110 * kMs);
  EXPECT_NEAR(after.largest_gap, 0.09, 1e-12);
  EXPECT_NEAR(after.coverage, 0.1, 1e-12);
  EXPECT_EQ(after.samples.back().angular_velocity, Reading(20).angular_velocity);
  EXPECT_EQ(after.samples.back().timestamp_ns, kStart + 110 * kMs);
  const ImuInterval before = buffer.Between(kStart - 90 * kMs, kStart + 10 * kMs);
  EXPECT_NEAR(before.coverage, 0.1, 1e-12);
  EXPECT_EQ(before.samples.front().angular_velocity, Reading(0).angular_velocity);
  const ImuInterval outside = buffer.Between(kStart + 200 * kMs, kStart + 300 * kMs);
  EXPECT_EQ(outside.coverage, 0);
  ASSERT_EQ(outside.samples.size(), 2u);
  const ImuInterval earlier = buffer.Between(kStart - 300 * kMs, kStart - 200 * kMs);
  EXPECT_EQ(earlier.coverage, 0);
  ASSERT_EQ(earlier.samples.size(), 2u);
  // A few missing milliseconds are no gap.
  EXPECT_TRUE(buffer.Between(kStart + 10 * kMs, kStart + 24 * kMs).complete());
}

TEST(ImuBuffer, IsEmptyWithoutReadingsOrTime) {
  EXPECT_TRUE(ImuBuffer({}, {}).Between(0, 10).samples.empty());
  EXPECT_FALSE(ImuBuffer({}, {}).Between(0, 10).complete());
  const ImuBuffer buffer(Readings({0, 5}), {});
  EXPECT_TRUE(buffer.Between(kStart + 5, kStart + 5).samples.empty());
  EXPECT_TRUE(buffer.Between(kStart + 5, kStart).samples.empty());
}

TEST(ImuBuffer, MovesByTheTimeOffset) {
  // Time of the IMU = time of the image + 20 ms: image time 5 ms is IMU time 25 ms.
  const ImuBuffer buffer(Readings({0, 10, 20, 30, 40}), {.time_offset = 0.02});
  const ImuInterval interval = buffer.Between(kStart + 5 * kMs, kStart + 10 * kMs);
  EXPECT_NEAR(interval.samples.front().angular_velocity.x(), 0.025, 1e-12);
  const ImuBuffer moved = buffer.WithTimeOffset(-0.01);
  EXPECT_NEAR(
      moved.Between(kStart + 25 * kMs, kStart + 30 * kMs).samples.front().angular_velocity.x(),
      0.015, 1e-12);
}

TEST(ImuBuffer, ReadingsThatFollowAreAsThoseFromTheBeginning) {
  const ImuBuffer whole(Readings({0, 5, 10, 10, 15, 20}), {.time_offset = 0.01});
  ImuBuffer grown(Readings({0, 5, 10}), {.time_offset = 0.02});
  grown = grown.WithTimeOffset(0.01);  // what follows comes in the corrected time
  grown.Append(Readings({10, 15}));
  grown.Append({});
  grown.Append(Readings({20}));
  EXPECT_EQ(grown.dropped(), 1);
  ASSERT_EQ(grown.samples().size(), whole.samples().size());
  for (std::size_t i = 0; i < whole.samples().size(); ++i) {
    EXPECT_EQ(grown.samples()[i].timestamp_ns, whole.samples()[i].timestamp_ns) << i;
    EXPECT_EQ(grown.samples()[i].angular_velocity, whole.samples()[i].angular_velocity) << i;
  }
}

TEST(ImuBuffer, CountsSaturatedReadings) {
  const ImuBuffer buffer(Readings({0, 5, 10, 15, 20}),
                         {.max_angular_velocity = 0.02, .max_acceleration = 0.03});
  EXPECT_EQ(buffer.Between(kStart, kStart + 20 * kMs).saturated, 2);  // 15 (acc.) and 20 ms
  EXPECT_EQ(buffer.Between(kStart, kStart + 10 * kMs).saturated, 0);
}

TEST(ImuBuffer, DropsReadingsThatRepeatOrGoBack) {
  const ImuBuffer buffer(Readings({0, 5, 5, 3, 10}), {});
  EXPECT_EQ(buffer.dropped(), 2);
  EXPECT_EQ(buffer.samples().size(), 3u);
}

TEST(ImuBuffer, RefusesWhatIsNotFinite) {
  std::vector<ImuSample> samples = Readings({0, 5});
  samples[1].acceleration.y() = std::numeric_limits<double>::quiet_NaN();
  try {
    const ImuBuffer buffer(samples, {});
    FAIL() << "accepted NaN";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("the IMU reading at 1700000000005000000 ns is not finite"));
  }
}

TEST(ImuBuffer, ValidatesItsOptions) {
  EXPECT_THROW(ImuBuffer({}, {.time_offset = std::numeric_limits<double>::quiet_NaN()}), Error);
  EXPECT_THROW(ImuBuffer({}, {.max_gap = 0}), Error);
  EXPECT_THROW(ImuBuffer({}, {.max_angular_velocity = -1}), Error);
  EXPECT_THROW(ImuBuffer({}, {.max_acceleration = 0}), Error);
}

}  // namespace
}  // namespace airslam
