// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/testing/synthetic_motion.h"

#include <gtest/gtest.h>

#include <cmath>

#include "airslam/geometry/so3.h"
#include "airslam/testing/synthetic_rig.h"

namespace airslam {
namespace {

constexpr std::int64_t kStart = 1'700'000'000'000'000'000;

std::vector<SyntheticTrajectory> AllTrajectories() {
  std::vector<SyntheticTrajectory> all = {SyntheticTrajectory::Loop(),
                                          SyntheticTrajectory::Forward(),
                                          SyntheticTrajectory::ForthAndBack()};
  for (SyntheticTrajectory& one : all) one.Mount(HeadingFromBody(EurocLikeRig()), kStart);
  return all;
}

TEST(SyntheticMotionTest, DerivativesAgreeWithDifferencesOfThePoses) {
  const std::int64_t step = 1'000'000;  // 1 ms
  const double h = 1e-9 * static_cast<double>(step);
  for (const SyntheticTrajectory& trajectory : AllTrajectories()) {
    for (std::int64_t time = kStart; time < kStart + 10'000'000'000; time += 731'000'000) {
      const BodyState state = trajectory.At(time);
      const BodyState before = trajectory.At(time - step), after = trajectory.At(time + step);
      const Eigen::Vector3d velocity =
          (after.world_from_body.translation - before.world_from_body.translation) / (2 * h);
      const Eigen::Vector3d acceleration =
          (after.velocity_in_world - before.velocity_in_world) / (2 * h);
      const Eigen::Vector3d omega =
          LogSO3(before.world_from_body.rotation.conjugate() * after.world_from_body.rotation) /
          (2 * h);
      EXPECT_LT((velocity - state.velocity_in_world).norm(), 1e-4);
      EXPECT_LT((acceleration - state.acceleration_in_world).norm(), 1e-4);
      EXPECT_LT((omega - state.angular_velocity_in_body).norm(), 1e-4);
    }
  }
}

TEST(SyntheticMotionTest, LoopPassesItsStartAgainAndForthAndBackRepeats) {
  for (const auto& [trajectory, period] : {std::pair(SyntheticTrajectory::Loop(20), 20.0),
                                           {SyntheticTrajectory::ForthAndBack(16), 16}}) {
    const BodyState start = trajectory.At(0);
    const BodyState again = trajectory.At(std::llround(period * 1e9));
    const BodyState middle = trajectory.At(std::llround(period * 0.5e9));
    const Rigid3 between = start.world_from_body.Inverse() * again.world_from_body;
    EXPECT_LT(between.translation.norm(), 1e-6);
    EXPECT_LT(between.Angle(), 1e-6);
    EXPECT_GT((middle.world_from_body.translation - start.world_from_body.translation).norm(), 4);
  }
}

TEST(SyntheticMotionTest, TheLeftCameraLooksAheadAndUpright) {
  for (const StereoRig& rig : {IdealRig(), EurocLikeRig(), KittiLikeRig()}) {
    SyntheticTrajectory trajectory = SyntheticTrajectory::Forward();
    trajectory.Mount(HeadingFromBody(rig), 0);
    const Rigid3 world_from_cam = trajectory.At(0).world_from_body * rig.left.body_from_cam;
    EXPECT_GT((world_from_cam.rotation * Eigen::Vector3d::UnitZ()).x(), 0.95);   // ahead
    EXPECT_LT((world_from_cam.rotation * Eigen::Vector3d::UnitY()).z(), -0.95);  // y is down
  }
}

TEST(SyntheticMotionTest, ExactReadingsIntegrateToTheTrajectory) {
  for (const SyntheticTrajectory& trajectory : AllTrajectories()) {
    ImuSimulationOptions options;
    options.noise.rate_hz = 1000;
    const std::int64_t end = kStart + 4'000'000'000;
    const ImuRecording imu = SimulateImu(trajectory, kStart, end, options);
    ASSERT_EQ(imu.samples.size(), 4001u);
    const BodyState start = trajectory.At(kStart), goal = trajectory.At(end);
    Eigen::Quaterniond rotation = start.world_from_body.rotation;
    Eigen::Vector3d position = start.world_from_body.translation;
    Eigen::Vector3d velocity = start.velocity_in_world;
    for (std::size_t i = 0; i + 1 < imu.samples.size(); ++i) {
      const ImuSample &a = imu.samples[i], &b = imu.samples[i + 1];
      const double dt = 1e-9 * static_cast<double>(b.timestamp_ns - a.timestamp_ns);
      const Eigen::Quaterniond next =
          rotation * ExpSO3(0.5 * dt * (a.angular_velocity + b.angular_velocity));
      const Eigen::Vector3d acceleration =
          0.5 * (rotation * a.acceleration + next * b.acceleration) + kGravityInWorld;
      position += velocity * dt + 0.5 * dt * dt * acceleration;
      velocity += dt * acceleration;
      rotation = next;
    }
    EXPECT_LT((position - goal.world_from_body.translation).norm(), 1e-3);
    EXPECT_LT((velocity - goal.velocity_in_world).norm(), 1e-3);
    EXPECT_LT(LogSO3(rotation.conjugate() * goal.world_from_body.rotation).norm(), 1e-4);
  }
}

TEST(SyntheticMotionTest, NoiseAndBiasesHaveTheAskedSize) {
  const SyntheticTrajectory trajectory = SyntheticTrajectory::Loop();
  ImuSimulationOptions exact, noisy;
  exact.noise.rate_hz = noisy.noise.rate_hz = 200;
  noisy.noise.gyroscope_noise_density = 1e-3;
  noisy.noise.accelerometer_random_walk = 0.01;
  noisy.gyroscope_bias = {0.01, -0.02, 0.03};
  const std::int64_t end = 100'000'000'000;
  const ImuRecording truth = SimulateImu(trajectory, 0, end, exact);
  const ImuRecording imu = SimulateImu(trajectory, 0, end, noisy);
  ASSERT_EQ(imu.samples.size(), truth.samples.size());
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  double square = 0, steps = 0;
  for (std::size_t i = 0; i < imu.samples.size(); ++i) {
    const Eigen::Vector3d error =
        imu.samples[i].angular_velocity - truth.samples[i].angular_velocity;
    mean += error;
    square += (error - noisy.gyroscope_bias).squaredNorm();
    // Without white noise the accelerometer is off by its bias exactly.
    EXPECT_LT(
        (imu.samples[i].acceleration - truth.samples[i].acceleration - imu.accelerometer_biases[i])
            .norm(),
        1e-12);
    if (i > 0)
      steps += (imu.accelerometer_biases[i] - imu.accelerometer_biases[i - 1]).squaredNorm();
  }
  const auto count = static_cast<double>(imu.samples.size());
  EXPECT_LT((mean / count - noisy.gyroscope_bias).norm(), 5e-4);
  EXPECT_NEAR(std::sqrt(square / (3 * count)), 1e-3 * std::sqrt(200.0), 2e-4);
  EXPECT_NEAR(std::sqrt(steps / (3 * count)), 0.01 / std::sqrt(200.0), 2e-5);
}

TEST(SyntheticMotionTest, AnImuAtRestOrientationReadsGravityUpwards) {
  // The body's x axis is up: the mean specific force of a level motion lies along it.
  SyntheticTrajectory trajectory = SyntheticTrajectory::Loop();
  trajectory.Mount(HeadingFromBody(IdealRig()), 0);
  ImuSimulationOptions options;
  options.noise.rate_hz = 100;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  const ImuRecording imu = SimulateImu(trajectory, 0, 20'000'000'000, options);
  for (const ImuSample& sample : imu.samples) mean += sample.acceleration;
  mean /= static_cast<double>(imu.samples.size());
  EXPECT_NEAR(mean.x(), 9.81, 0.1);
  EXPECT_LT(mean.tail<2>().norm(), 0.5);
}

}  // namespace
}  // namespace airslam
