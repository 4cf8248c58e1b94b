// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/inertial_initialization.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iostream>
#include <numbers>
#include <random>

#include "airslam/common/error.h"
#include "airslam/geometry/so3.h"
#include "airslam/testing/recorded_motion.h"
#include "airslam/testing/synthetic_motion.h"
#include "airslam/testing/synthetic_world.h"

namespace airslam {
namespace {

using ::testing::HasSubstr;

constexpr std::int64_t kStart = 1'700'000'000'000'000'000;
constexpr double kDegrees = 180 / std::numbers::pi;
const Rigid3 kBodyFromCam{Eigen::Quaterniond(0.5, -0.5, 0.5, -0.5), {0.06, -0.02, 0.1}};
const ImuNoise kNoise{1.7e-4, 2e-5, 2e-3, 3e-3, 200};
const ImuBias kBias{{0.02, -0.03, 0.07}, {-0.08, 0.15, 0.1}};

// The estimate's world is the first camera's of a run: turned away from gravity's.
const Rigid3 kWorldFromTrue{Eigen::Quaterniond(0.7, 0.3, -0.5, 0.2), {1, 2, 3}};

double AngleBetween(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return kDegrees * std::atan2(a.cross(b).norm(), a.dot(b));
}

struct Start {
  double begin = 0.3, duration = 3, rate = 10;          // seconds, frames a second
  double pose_rotation = 3e-4, pose_position = 1.5e-3;  // noise: rad, m
  double imu_delay = 0;  // seconds: readings are stamped so much too late
  ImuBias bias = kBias;
  std::uint32_t seed = 1;
};

struct Recording {
  std::vector<InertialFrame> frames;
  std::vector<ImuSample> samples;
  std::vector<Eigen::Vector3d> velocities;
};

Recording Record(const SyntheticTrajectory& motion, const Start& start) {
  Recording recording;
  ImuSimulationOptions options;
  options.noise = kNoise;
  options.gyroscope_bias = start.bias.gyroscope;
  options.accelerometer_bias = start.bias.accelerometer;
  options.seed = start.seed;
  const auto after = [](double seconds) { return kStart + std::llround(seconds * 1e9); };
  recording.samples = SimulateImu(motion, after(start.begin - 0.2),
                                  after(start.begin + start.duration + 0.2), options)
                          .samples;
  for (ImuSample& sample : recording.samples) {
    sample.timestamp_ns += std::llround(start.imu_delay * 1e9);
  }
  std::mt19937 random(start.seed + 1000);
  const auto noise = [&random](double sigma) -> Eigen::Vector3d {
    return sigma * Eigen::Vector3d(Normal(random), Normal(random), Normal(random));
  };
  for (int i = 0; i <= std::llround(start.duration * start.rate); ++i) {
    const BodyState state = motion.At(after(start.begin + i / start.rate));
    const Eigen::Vector3d turn = noise(start.pose_rotation), shift = noise(start.pose_position);
    recording.frames.push_back(
        {state.timestamp_ns,
         kWorldFromTrue * state.world_from_body * kBodyFromCam * Rigid3(ExpSO3(turn), shift)});
    recording.velocities.push_back(kWorldFromTrue.rotation * state.velocity_in_world);
  }
  return recording;
}

InertialInitialization Initialize(const Recording& recording, const ImuBufferOptions& buffer = {},
                                  const InertialInitializationOptions& options = {}) {
  return InitializeInertial(options, recording.frames, ImuBuffer(recording.samples, buffer), kNoise,
                            kBodyFromCam);
}

// A brisk walk in circles, as a handheld rig: both turns and accelerations.
SyntheticTrajectory Brisk(std::uint32_t seed = 1) {
  return SyntheticTrajectory::Loop(6, seed).Mount(Eigen::Quaterniond(0.1, 0.7, -0.7, 0.1), kStart);
}

TEST(InertialInitialization, FindsGravityAndBiasesOfAMovingStart) {
  const Eigen::Vector3d gravity = kWorldFromTrue.rotation * kGravityInWorld;
  for (std::uint32_t seed = 1; seed <= 5; ++seed) {
    const Recording recording = Record(Brisk(seed), {.seed = seed});
    const InertialInitialization result = Initialize(recording);
    ASSERT_TRUE(result.ok()) << result.reason;
    EXPECT_FALSE(result.at_rest);
    EXPECT_LT(AngleBetween(result.gravity_in_world, gravity), 0.5);
    EXPECT_NEAR(result.gravity_in_world.norm(), 9.81, 1e-9);
    EXPECT_LT((result.bias.gyroscope - kBias.gyroscope).norm(), 0.005);
    EXPECT_LT((result.bias.accelerometer - kBias.accelerometer).norm(), 0.1);
    ASSERT_EQ(result.velocities_in_world.size(), recording.frames.size());
    double worst = 0;
    for (std::size_t i = 0; i < recording.velocities.size(); ++i) {
      worst = std::max(worst, (result.velocities_in_world[i] - recording.velocities[i]).norm());
    }
    EXPECT_LT(worst, 0.05);
    // What it says of itself is true: within four of its standard deviations.
    EXPECT_LT(AngleBetween(result.gravity_in_world, gravity), 4 * kDegrees * result.gravity_sigma);
    EXPECT_LT((result.bias.gyroscope - kBias.gyroscope).norm(), 5 * result.gyroscope_bias_sigma);
    EXPECT_LT((result.bias.accelerometer - kBias.accelerometer).norm(),
              5 * result.accelerometer_bias_sigma);
    std::cout << "gravity " << AngleBetween(result.gravity_in_world, gravity) << " deg (sigma "
              << kDegrees * result.gravity_sigma << "), gyroscope "
              << (result.bias.gyroscope - kBias.gyroscope).norm() << " rad/s (sigma "
              << result.gyroscope_bias_sigma << "), accelerometer "
              << (result.bias.accelerometer - kBias.accelerometer).norm() << " m/s^2 (sigma "
              << result.accelerometer_bias_sigma << "), velocity " << worst << " m/s, residual "
              << result.residual << ", offset " << 1e3 * result.time_offset << " ms (sigma "
              << 1e3 * result.time_offset_sigma << ")\n";
  }
}

TEST(InertialInitialization, IsDeterministic) {
  const Recording recording = Record(Brisk(), {});
  const InertialInitialization a = Initialize(recording), b = Initialize(recording);
  EXPECT_EQ(a.gravity_in_world, b.gravity_in_world);
  EXPECT_EQ(a.bias.accelerometer, b.bias.accelerometer);
  EXPECT_EQ(a.gravity_sigma, b.gravity_sigma);
}

// Frames of one pose with their noise, and an IMU that reads gravity.
Recording AtRest(double duration) {
  const BodyState state = Brisk().At(kStart);
  Recording recording;
  std::mt19937 random(3);
  const auto noise = [&random](double sigma) -> Eigen::Vector3d {
    return sigma * Eigen::Vector3d(Normal(random), Normal(random), Normal(random));
  };
  for (int i = 0; i <= duration * 200; ++i) {
    recording.samples.push_back({kStart + i * 5'000'000, kBias.gyroscope + noise(2.4e-3),
                                 kBias.accelerometer -
                                     state.world_from_body.rotation.conjugate() * kGravityInWorld +
                                     noise(0.028)});
  }
  for (int i = 0; i <= duration * 10; ++i) {
    recording.frames.push_back(
        {kStart + i * 100'000'000, kWorldFromTrue * state.world_from_body * kBodyFromCam *
                                       Rigid3(ExpSO3(noise(3e-4)), noise(1.5e-3))});
  }
  return recording;
}

TEST(InertialInitialization, TakesGravityFromAStartAtRest) {
  const InertialInitialization result = Initialize(AtRest(1));
  ASSERT_TRUE(result.ok()) << result.reason;
  EXPECT_TRUE(result.at_rest);
  const double angle =
      AngleBetween(result.gravity_in_world, kWorldFromTrue.rotation * kGravityInWorld);
  // Only as good as the accelerometer's bias allows, and it says so.
  EXPECT_LT(angle, 1.2);
  EXPECT_GT(angle, 0.1);
  EXPECT_LT(angle, 2 * kDegrees * result.gravity_sigma);
  EXPECT_LT((result.bias.gyroscope - kBias.gyroscope).norm(), 1e-3);
  EXPECT_LT((result.bias.accelerometer - kBias.accelerometer).norm(),
            2 * result.accelerometer_bias_sigma);
  for (const Eigen::Vector3d& v : result.velocities_in_world) EXPECT_EQ(v, Eigen::Vector3d::Zero());
}

TEST(InertialInitialization, RefusesAnAccelerometerThatMissesGravity) {
  Recording recording = AtRest(1);
  for (ImuSample& sample : recording.samples) sample.acceleration *= 0.5;
  const InertialInitialization result = Initialize(recording);
  EXPECT_EQ(result.refusal, InertialRefusal::kInconsistent);
  EXPECT_THAT(result.reason, HasSubstr("at rest the accelerometer reads 4."));
}

TEST(InertialInitialization, RefusesTooShortAStart) {
  const InertialInitialization moving = Initialize(Record(Brisk(), {.duration = 1}));
  EXPECT_EQ(moving.refusal, InertialRefusal::kTooShort);
  EXPECT_THAT(moving.reason, HasSubstr("a moving start needs"));
  EXPECT_EQ(Initialize(Record(Brisk(), {.duration = 0.2})).refusal, InertialRefusal::kTooShort);
  EXPECT_EQ(Initialize(Recording()).refusal, InertialRefusal::kTooShort);
  EXPECT_EQ(Initialize(AtRest(0.3)).refusal, InertialRefusal::kTooShort);
}

TEST(InertialInitialization, RefusesAGapInTheReadings) {
  Recording recording = Record(Brisk(), {});
  recording.samples.erase(recording.samples.begin() + 200, recording.samples.begin() + 240);
  const InertialInitialization result = Initialize(recording);
  EXPECT_EQ(result.refusal, InertialRefusal::kImuGap);
  EXPECT_THAT(result.reason, HasSubstr("the largest gap is 0.205 s"));
  recording.samples.clear();
  EXPECT_EQ(Initialize(recording).refusal, InertialRefusal::kImuGap);
}

TEST(InertialInitialization, RefusesSaturatedReadings) {
  const InertialInitialization result = Initialize(Record(Brisk(), {}), {.max_acceleration = 9.7});
  EXPECT_EQ(result.refusal, InertialRefusal::kSaturated);
}

TEST(InertialInitialization, RefusesAMotionThatDoesNotTellGravityFromBias) {
  // A slow glide along a line.
  const auto glide = SyntheticTrajectory::Forward(0.5).Mount(kWorldFromTrue.rotation, kStart);
  const InertialInitialization result = Initialize(Record(glide, {.duration = 2}));
  EXPECT_EQ(result.refusal, InertialRefusal::kNotExcited);
  EXPECT_THAT(result.reason, HasSubstr("leaves gravity uncertain by"));
}

TEST(InertialInitialization, RefusesAWrongScale) {
  Recording recording = Record(Brisk(), {});
  for (InertialFrame& frame : recording.frames) frame.world_from_cam.translation *= 3;
  EXPECT_EQ(Initialize(recording).refusal, InertialRefusal::kInconsistent);
}

TEST(InertialInitialization, RefusesPosesThatContradictTheReadings) {
  // Poses twenty times as noisy as they are said to be.
  const InertialInitialization result =
      Initialize(Record(Brisk(), {.pose_rotation = 1e-2, .pose_position = 0.06}));
  EXPECT_EQ(result.refusal, InertialRefusal::kInconsistent);
  EXPECT_THAT(result.reason, HasSubstr("standard deviations"));
}

TEST(InertialInitialization, RefusesFramesThatGoBackInTime) {
  Recording recording = Record(Brisk(), {});
  std::swap(recording.frames[3], recording.frames[4]);
  EXPECT_EQ(Initialize(recording).refusal, InertialRefusal::kInconsistent);
}

TEST(InertialInitialization, RefusesAPoseThatIsNotFinite) {
  Recording recording = AtRest(1);
  recording.frames[3].world_from_cam.translation.x() = std::nan("");
  const InertialInitialization result = Initialize(recording);
  EXPECT_EQ(result.refusal, InertialRefusal::kInconsistent);
  EXPECT_THAT(result.reason, HasSubstr("frame 3 is not finite"));
}

TEST(InertialInitialization, DetectsAWrongTimeOffset) {
  for (const double delay : {-0.02, 0.02}) {
    const Recording recording = Record(Brisk(), {.duration = 5, .imu_delay = delay});
    const InertialInitialization result = Initialize(recording);
    EXPECT_EQ(result.refusal, InertialRefusal::kTimeOffset) << result.reason;
    EXPECT_NEAR(result.time_offset, delay, 0.003);
    EXPECT_GT(result.time_offset_sigma, 0);
    std::cout << "offset " << 1e3 * result.time_offset << " of " << 1e3 * delay << " ms (sigma "
              << 1e3 * result.time_offset_sigma << ")\n";
    // Corrected by what it found, it goes.
    const InertialInitialization corrected =
        Initialize(recording, {.time_offset = result.time_offset});
    EXPECT_TRUE(corrected.ok()) << corrected.reason;
    EXPECT_LT(std::abs(corrected.time_offset), 0.003);
  }
}

TEST(InertialInitialization, ValidatesItsOptions) {
  const Recording recording = Record(Brisk(), {});
  EXPECT_THROW(Initialize(recording, {}, {.min_frames = 2}), Error);
  EXPECT_THROW(Initialize(recording, {}, {.sigma_position = 0}), Error);
  EXPECT_THROW(Initialize(recording, {}, {.time_offset_search = 0.001}), Error);
}

TEST(InertialInitialization, NamesEachRefusal) {
  EXPECT_EQ(ToString(InertialRefusal::kNotExcited), "not excited");
  EXPECT_EQ(ToString(InertialRefusal::kImuGap), "IMU gap");
}

// --- Recorded data -------------------------------------------------------------------------------

const std::filesystem::path kData = std::filesystem::path(AIRSLAM_SOURCE_DIR) / "../shared/data";

// Frames from the ground truth of a recorded sequence: every `every`-th state from `first` on.
std::vector<InertialFrame> TrueFrames(const std::vector<RecordedState>& states, std::size_t first,
                                      int every, int count) {
  std::vector<InertialFrame> frames;
  for (int i = 0; i < count; ++i) {
    const RecordedState& state = states.at(first + static_cast<std::size_t>(i * every));
    frames.push_back({state.timestamp_ns, kWorldFromTrue * state.world_from_body * kBodyFromCam});
  }
  return frames;
}

TEST(InertialInitializationData, WarehouseAtAnyStart) {
  const std::filesystem::path mav = kData / "warehouse_day/mav0";
  if (!std::filesystem::exists(mav)) GTEST_SKIP() << mav << " is not there: nothing to compare";
  const auto states = ReadRecordedStates(mav / "state_groundtruth_estimate0/data.csv");
  const ImuBuffer imu(ReadRecordedImu(mav / "imu0/data.csv"), {});
  const Eigen::Vector3d gravity = kWorldFromTrue.rotation * kGravityInWorld;
  for (const int count : {21, 31, 51}) {  // frames at 10 Hz
    int accepted = 0, starts = 0;
    double gravity_error = 0, gyroscope_error = 0, accelerometer_error = 0, offset = 0,
           residual = 0;
    for (std::size_t first = 0; first + 20 * (count - 1) < states.size(); first += 200) {
      ++starts;
      const InertialInitialization result =
          InitializeInertial({}, TrueFrames(states, first, 20, count), imu, kNoise, kBodyFromCam);
      if (!result.ok()) {
        std::cout << count << " frames from " << first << ": " << result.reason << "\n";
        continue;
      }
      ++accepted;
      const RecordedState& truth = states[first + 10 * (count - 1)];
      gravity_error = std::max(gravity_error, AngleBetween(result.gravity_in_world, gravity));
      gyroscope_error =
          std::max(gyroscope_error, (result.bias.gyroscope - truth.gyroscope_bias).norm());
      accelerometer_error = std::max(accelerometer_error,
                                     (result.bias.accelerometer - truth.accelerometer_bias).norm());
      offset = std::max(offset, std::abs(result.time_offset));
      residual = std::max(residual, result.residual);
    }
    std::cout << count << " frames: " << accepted << " of " << starts
              << " starts accepted; worst errors: gravity " << gravity_error << " deg, gyroscope "
              << gyroscope_error << " rad/s, accelerometer " << accelerometer_error
              << " m/s^2, time offset " << 1e3 * offset << " ms; residual " << residual << "\n";
    EXPECT_LT(gravity_error, 0.5);
    EXPECT_LT(gyroscope_error, 0.005);
    EXPECT_LT(accelerometer_error, 0.1);
    EXPECT_GT(accepted, count == 51 ? starts / 2 : -1);
  }
}

TEST(InertialInitializationData, WarehouseTimeOffset) {
  const std::filesystem::path mav = kData / "warehouse_day/mav0";
  if (!std::filesystem::exists(mav)) GTEST_SKIP() << mav << " is not there: nothing to compare";
  const auto states = ReadRecordedStates(mav / "state_groundtruth_estimate0/data.csv");
  for (const double wrong : {-0.02, 0.02}) {
    const ImuBuffer imu(ReadRecordedImu(mav / "imu0/data.csv"), {.time_offset = wrong});
    const InertialInitialization result =
        InitializeInertial({}, TrueFrames(states, 400, 20, 31), imu, kNoise, kBodyFromCam);
    EXPECT_EQ(result.refusal, InertialRefusal::kTimeOffset) << result.reason;
    EXPECT_NEAR(result.time_offset, -wrong, 0.003);
    std::cout << "offset " << 1e3 * result.time_offset << " of " << -1e3 * wrong << " ms (sigma "
              << 1e3 * result.time_offset_sigma << ")\n";
  }
}

TEST(InertialInitializationData, EurocAtRest) {
  const std::filesystem::path mav = kData / "euroc_v101_start/mav0";
  if (!std::filesystem::exists(mav)) GTEST_SKIP() << mav << " is not there: nothing to compare";
  const auto states = ReadRecordedStates(mav / "state_groundtruth_estimate0/data.csv");
  const ImuBuffer imu(ReadRecordedImu(mav / "imu0/data.csv"), {});
  for (const std::size_t first : {0, 30, 75}) {  // the images begin with state 75
    const InertialInitialization result =
        InitializeInertial({}, TrueFrames(states, first, 1, 21), imu, kNoise, kBodyFromCam);
    ASSERT_TRUE(result.ok()) << result.reason;
    EXPECT_TRUE(result.at_rest);
    const double gravity =
        AngleBetween(result.gravity_in_world, kWorldFromTrue.rotation * kGravityInWorld);
    const double gyroscope = (result.bias.gyroscope - states[first + 10].gyroscope_bias).norm();
    const double accelerometer =
        (result.bias.accelerometer - states[first + 10].accelerometer_bias).norm();
    std::cout << "at rest from state " << first << ": gravity " << gravity << " deg, gyroscope "
              << gyroscope << " rad/s, accelerometer " << accelerometer << " m/s^2\n";
    // 0.22 degrees are the ground truth's own: with its biases taken off, the readings at rest lean
    // by as much. The rest is the bias across gravity, which nothing tells at rest.
    EXPECT_LT(gravity, 0.8);
    EXPECT_LT(gravity, kDegrees * result.gravity_sigma);
    EXPECT_LT(gyroscope, 0.005);
    EXPECT_LT(accelerometer, 0.1);
  }
}

}  // namespace
}  // namespace airslam
