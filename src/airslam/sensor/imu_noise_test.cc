// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/sensor/imu_noise.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace airslam {
namespace {

// A second of 200 Hz with noise of these densities on top of a brisk motion.
std::vector<ImuSample> Readings(double gyroscope, double accelerometer) {
  std::mt19937 random(4);
  std::normal_distribution<double> normal;
  const auto noise = [&](double density) -> Eigen::Vector3d {
    return density * std::sqrt(200.0) *
           Eigen::Vector3d(normal(random), normal(random), normal(random));
  };
  std::vector<ImuSample> samples;
  for (int k = 0; k < 200; ++k) {
    const double t = k / 200.0;
    samples.push_back({k * 5'000'000LL,
                       Eigen::Vector3d(std::sin(3 * t), 0.5, std::cos(5 * t)) + noise(gyroscope),
                       Eigen::Vector3d(3 * std::sin(6 * t), 0, 9.81) + noise(accelerometer)});
  }
  return samples;
}

const ImuNoise kCalibrated{1.7e-4, 1.9e-5, 2e-3, 3e-3, 200};

TEST(WithMeasuredNoise, LeavesAModelThatIsRight) {
  const ImuNoise noise = WithMeasuredNoise(kCalibrated, Readings(1.7e-4, 2e-3));
  EXPECT_NEAR(noise.gyroscope_noise_density, 1.7e-4, 0.3e-4);
  EXPECT_NEAR(noise.accelerometer_noise_density, 2e-3, 0.3e-3);
  EXPECT_EQ(noise.gyroscope_random_walk, kCalibrated.gyroscope_random_walk);
  EXPECT_EQ(noise.accelerometer_random_walk, kCalibrated.accelerometer_random_walk);
  const ImuNoise quiet = WithMeasuredNoise(kCalibrated, Readings(0, 0));
  EXPECT_EQ(quiet.gyroscope_noise_density, kCalibrated.gyroscope_noise_density);
}

TEST(WithMeasuredNoise, FollowsShakingReadings) {
  const ImuNoise noise = WithMeasuredNoise(kCalibrated, Readings(5e-3, 0.09));
  EXPECT_NEAR(noise.gyroscope_noise_density, 5e-3, 5e-4);
  EXPECT_NEAR(noise.accelerometer_noise_density, 0.09, 0.009);
}

TEST(WithMeasuredNoise, NeedsEnoughEvenReadings) {
  std::vector<ImuSample> samples = Readings(5e-3, 0.09);
  samples.resize(8);
  EXPECT_EQ(WithMeasuredNoise(kCalibrated, samples).gyroscope_noise_density, 1.7e-4);
  EXPECT_EQ(WithMeasuredNoise(kCalibrated, {}).gyroscope_noise_density, 1.7e-4);
  samples = Readings(5e-3, 0.09);
  std::int64_t shift = 0;
  for (std::size_t k = 0; k < samples.size(); ++k) {  // steps of 5 and 15 ms in turn
    samples[k].timestamp_ns += shift;
    if (k % 2 == 0) shift += 10'000'000;
  }
  EXPECT_EQ(WithMeasuredNoise(kCalibrated, samples).gyroscope_noise_density, 1.7e-4);
}

}  // namespace
}  // namespace airslam
