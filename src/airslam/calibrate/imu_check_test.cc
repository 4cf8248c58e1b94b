// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/calibrate/imu_check.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "airslam/geometry/so3.h"
#include "airslam/testing/synthetic_motion.h"
#include "airslam/testing/synthetic_rig.h"

namespace airslam {
namespace {

constexpr std::int64_t kStart = 1'000'000'000;

SyntheticTrajectory Motion(const StereoRig& rig) {
  return SyntheticTrajectory::ForthAndBack(8).Mount(HeadingFromBody(rig), kStart);
}

std::vector<ImuSample> Readings(const StereoRig& rig) {
  ImuSimulationOptions options;
  options.noise = *rig.imu;
  options.gyroscope_bias = {0.02, -0.01, 0.03};
  return SimulateImu(Motion(rig), kStart, kStart + 12'000'000'000, options).samples;
}

// The left camera's exact turns with a little noise, every tenth of them wrong.
std::vector<VisualTurn> Turns(const StereoRig& rig, double noise) {
  std::mt19937 random(5);
  std::normal_distribution<double> normal(0, noise);
  std::vector<VisualTurn> turns;
  for (int i = 0; i < 30; ++i) {
    const std::int64_t from = kStart + 1'000'000'000 + i * 330'000'000LL, to = from + 300'000'000;
    const auto camera = [&](std::int64_t time) {
      return Motion(rig).At(time).world_from_body * rig.left.body_from_cam;
    };
    const Rigid3 moved = camera(from).Inverse() * camera(to);
    Eigen::Vector3d vector = LogSO3(moved.rotation);
    for (double& v : vector) v += normal(random);
    if (i % 10 == 4) vector = -vector;
    turns.push_back({from, to, vector, noise});
  }
  return turns;
}

TEST(CheckImu, AgreesWithAGoodCalibration) {
  const StereoRig rig = EurocLikeRig();
  const ImuCheck check = CheckImu(rig, Readings(rig), Turns(rig, 5e-4));
  EXPECT_EQ(check.unknown, "");
  EXPECT_GT(check.time_offset_sigma, 0);
  EXPECT_LT(std::abs(check.time_offset), 5 * check.time_offset_sigma);
  EXPECT_LT((check.gyroscope_bias - Eigen::Vector3d(0.02, -0.01, 0.03)).norm(), 5e-3);
  EXPECT_NEAR(check.turn_ratio, 1, 0.02);
}

TEST(CheckImu, FindsTheOffsetOfTheClock) {
  StereoRig rig = EurocLikeRig();
  std::vector<ImuSample> readings = Readings(rig);
  for (ImuSample& sample : readings) sample.timestamp_ns += 73'000'000;
  rig.imu_time_offset = 0.1;  // calibrated
  const ImuCheck check = CheckImu(rig, readings, Turns(rig, 5e-4));
  EXPECT_NEAR(check.time_offset, -0.027, 0.004);
}

TEST(CheckImu, FindsTheOrientationOfTheCamera) {
  StereoRig rig = EurocLikeRig();
  const std::vector<ImuSample> readings = Readings(rig);
  const std::vector<VisualTurn> turns = Turns(rig, 2e-4);
  const Eigen::Vector3d turn(0.1, -0.2, 0.15);
  rig.left.body_from_cam.rotation = rig.left.body_from_cam.rotation * ExpSO3(-turn);
  const ImuCheck check = CheckImu(rig, readings, turns);
  if (check.rotation_sigma == 0) GTEST_FAIL() << "the motion turns about more than one axis";
  EXPECT_LT((check.rotation - turn).norm(), 5 * check.rotation_sigma + 0.01);
}

TEST(CheckImu, SaysWhyItCannotTell) {
  const StereoRig rig = EurocLikeRig();
  std::vector<VisualTurn> turns = Turns(rig, 5e-4);
  for (VisualTurn& turn : turns) turn.vector *= 1e-4;
  EXPECT_NE(CheckImu(rig, Readings(rig), turns).unknown.find("turns too little"),
            std::string::npos);
  turns.resize(3);
  EXPECT_NE(CheckImu(rig, Readings(rig), turns).unknown.find("only 3 pairs"), std::string::npos);
}

// What one camera sees of random points before and after it moved.
TEST(EstimateTurn, WithAndWithoutMotionOfTheCentre) {
  const DistortedCamera camera = EurocLikeRig().left.camera;
  std::mt19937 random(2);
  std::uniform_real_distribution<double> unit(0, 1);
  for (const double distance : {0.0, 0.3}) {
    const Rigid3 from_to(ExpSO3({0.05, -0.1, 0.03}), distance * Eigen::Vector3d(0.3, 0.1, 0.9));
    RawMotion motion{0, 300'000'000, {}, {}};
    while (motion.from.size() < 100) {
      const Eigen::Vector3d point(4 * unit(random) - 2, 3 * unit(random) - 1.5,
                                  2 + 4 * unit(random));
      const Eigen::Vector2d a = camera.Project(point),
                            b = camera.Project(from_to.Inverse() * point);
      if (!camera.pinhole.Contains(a) || !camera.pinhole.Contains(b)) continue;
      motion.from.push_back(a);
      motion.to.push_back(b);
    }
    const auto turn = EstimateTurn(camera, motion);
    ASSERT_TRUE(turn);
    EXPECT_LT((turn->vector - Eigen::Vector3d(0.05, -0.1, 0.03)).norm(), 1e-3) << distance;
  }
  EXPECT_FALSE(EstimateTurn(camera, {0, 1, {{1, 1}}, {{2, 2}}}));
}

}  // namespace
}  // namespace airslam
