// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/inertial_bundle.h"

#include <gtest/gtest.h>

#include <random>

#include "airslam/common/error.h"
#include "airslam/geometry/so3.h"
#include "airslam/optimize/bundle.h"
#include "airslam/sensor/imu_buffer.h"
#include "airslam/testing/synthetic_motion.h"

namespace airslam {
namespace {

constexpr std::int64_t kStart = 1'700'000'000'000'000'000;
constexpr std::int64_t kStep = 400'000'000;  // ns between keyframes
constexpr int kKeyframes = 8;
const Rigid3 kBodyFromCam{Eigen::Quaterniond(0.7, -0.1, 0.2, 0.68), {0.06, -0.02, 0.1}};
const ImuNoise kNoise{2e-4, 2e-5, 2e-3, 3e-3, 200};
const ImuBias kBias{{0.01, -0.02, 0.03}, {0.1, 0.2, -0.1}};

// Keyframes of the synthetic motion that see a cloud of points with 0.3 pixels of noise, and an
// IMU. All starts near the truth; velocities and biases start at zero.
class InertialBundleTest : public ::testing::Test {
 protected:
  InertialBundleTest() {
    ImuSimulationOptions options;
    options.noise = kNoise;
    options.gyroscope_bias = kBias.gyroscope;
    options.accelerometer_bias = kBias.accelerometer;
    const std::int64_t end = kStart + kKeyframes * kStep;
    const ImuBuffer buffer(SimulateImu(motion_, kStart, end, options).samples, {});
    problem_.stereo = {{450, 455, 320, 240, 640, 480}, 0.12};
    problem_.inertial.gravity_in_world = kGravityInWorld;
    problem_.inertial.body_from_cam = kBodyFromCam;
    for (int i = 0; i < kKeyframes; ++i) {
      const std::int64_t time = kStart + i * kStep;
      truth_.push_back(motion_.At(time));
      problem_.world_from_cam.push_back(Cam(i));
      problem_.pose_fixed.push_back(i == 0);
      problem_.inertial.states.push_back({i, Eigen::Vector3d::Zero(), {}});
      if (i == 0) continue;
      problem_.inertial.links.push_back(
          {i - 1, i,
           std::make_shared<const ImuPreintegration>(buffer.Between(time - kStep, time).samples,
                                                     kNoise, kBias)});
    }
    problem_.inertial.priors.push_back({0, {}, 0.04 * Matrix6d::Identity()});
    AddPoints();
    for (int i = 1; i < kKeyframes; ++i) Disturb(i, 0.003, 0.02);
  }

  Rigid3 Cam(int i) const { return truth_[i].world_from_body * kBodyFromCam; }

  void Disturb(int i, double angle, double distance) {
    problem_.world_from_cam[i] =
        Cam(i) * Rigid3(ExpSO3({angle, -angle, angle}), {distance, -distance, distance});
  }

  void AddPoints() {
    std::mt19937 random(5);
    std::uniform_real_distribution<double> unit(-1, 1);
    std::normal_distribution<double> noise(0, 0.3);
    for (int i = 0; i < kKeyframes; ++i) {
      for (int k = 0; k < 40; ++k) {  // in front of keyframe i
        const double z = 4 + 2 * unit(random);
        const Eigen::Vector3d point =
            Cam(i) * Eigen::Vector3d(0.6 * z * unit(random), 0.45 * z * unit(random), z);
        const int index = static_cast<int>(problem_.points_in_world.size());
        problem_.points_in_world.push_back(point + 0.05 * Eigen::Vector3d::Random());
        for (int j = 0; j < kKeyframes; ++j) {
          const Eigen::Vector3d p = Cam(j).Inverse() * point;
          if (p.z() < 0.5) continue;
          const Eigen::Vector2d pixel = problem_.stereo.camera.Project(p);
          if (!problem_.stereo.camera.Contains(pixel)) continue;
          const double right = pixel.x() - problem_.stereo.Disparity(p.z()) + noise(random);
          problem_.observations.push_back(
              {j, index, {pixel + Eigen::Vector2d(noise(random), noise(random)), right, 0.3}});
        }
      }
    }
  }

  // Of keyframe i after solving, metres.
  double PositionError(int i) const {
    return (problem_.world_from_cam[i].translation - Cam(i).translation).norm();
  }
  double VelocityError(int i) const {
    return (problem_.inertial.states[i].velocity_in_world - truth_[i].velocity_in_world).norm();
  }

  SyntheticTrajectory motion_ =
      SyntheticTrajectory::Loop(10, 3).Mount(Eigen::Quaterniond(0.5, 0.5, -0.5, 0.5), kStart);
  std::vector<BodyState> truth_;
  BundleProblem problem_;
};

TEST_F(InertialBundleTest, FindsVelocitiesAndBiases) {
  SolveBundle({}, &problem_);
  for (int i = 0; i < kKeyframes; ++i) {
    EXPECT_LT(PositionError(i), 0.01) << i;
    EXPECT_LT(VelocityError(i), 0.02) << i;
    const ImuBias& bias = problem_.inertial.states[i].bias;
    EXPECT_LT((bias.gyroscope - kBias.gyroscope).norm(), 1e-3) << i;
    EXPECT_LT((bias.accelerometer - kBias.accelerometer).norm(), 0.05) << i;
  }
  EXPECT_EQ(problem_.inertial.gravity_in_world, kGravityInWorld);
}

// A keyframe that sees nothing that others see hangs on the readings.
TEST_F(InertialBundleTest, TheReadingsHoldAKeyframeThatVisionDoesNot) {
  std::erase_if(problem_.observations,
                [](const BundleProblem::Observation& o) { return o.pose == 5; });
  Disturb(5, 0.05, 0.3);
  SolveBundle({}, &problem_);
  EXPECT_LT(PositionError(5), 0.01);
  EXPECT_LT(VelocityError(5), 0.02);
}

TEST_F(InertialBundleTest, GravityThatIsNotHeldIsFound) {
  const Eigen::Vector3d tilted = ExpSO3({0.02, -0.01, 0}) * kGravityInWorld;
  problem_.inertial.gravity_in_world = tilted;
  problem_.inertial.gravity_sigma = 0.05;
  SolveBundle({}, &problem_);
  const Eigen::Vector3d& found = problem_.inertial.gravity_in_world;
  EXPECT_NEAR(found.norm(), 9.81, 1e-9);
  EXPECT_LT(found.cross(kGravityInWorld).norm() / (9.81 * 9.81), 0.007);
}

// Readings that contradict the points count less (with their full weight they move it by metres).
TEST_F(InertialBundleTest, WrongReadingsDoNotBendTheMap) {
  const ImuPreintegration& good = *problem_.inertial.links[3].readings;
  std::vector<ImuSample> samples = good.samples();
  for (ImuSample& sample : samples) sample.acceleration.x() += 5;
  problem_.inertial.links[3].readings =
      std::make_shared<const ImuPreintegration>(samples, kNoise, kBias);
  SolveBundle({}, &problem_);
  for (int i = 0; i < kKeyframes; ++i) EXPECT_LT(PositionError(i), 0.04) << i;
}

// The same readings pull less where the points scatter less than their sigma says.
TEST_F(InertialBundleTest, IsWeighedAgainstWhatThePointsShow) {
  BundleProblem modest = problem_;
  for (BundleProblem::Observation& o : modest.observations) o.seen.sigma = 1.2;  // four times
  SolveBundle({}, &problem_);
  SolveBundle({}, &modest);
  for (int i = 0; i < kKeyframes; ++i) {
    const Rigid3 difference = problem_.world_from_cam[i].Inverse() * modest.world_from_cam[i];
    EXPECT_LT(difference.translation.norm(), 1e-3) << i;
  }
}

TEST_F(InertialBundleTest, RepeatsBitByBit) {
  BundleProblem again = problem_;
  SolveBundle({}, &problem_);
  SolveBundle({}, &again);
  for (int i = 0; i < kKeyframes; ++i) {
    EXPECT_EQ(problem_.world_from_cam[i].ToMatrix(), again.world_from_cam[i].ToMatrix());
    EXPECT_EQ(problem_.inertial.states[i].velocity_in_world,
              again.inertial.states[i].velocity_in_world);
  }
}

TEST_F(InertialBundleTest, RefusesAPriorThatIsNone) {
  problem_.inertial.priors[0].covariance.setZero();
  EXPECT_THROW(SolveBundle({}, &problem_), Error);
}

}  // namespace
}  // namespace airslam
