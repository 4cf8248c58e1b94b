// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <array>
#include <cstdint>
#include <vector>

#include "airslam/geometry/rigid3.h"
#include "airslam/sensor/imu.h"

namespace airslam {

// Gravity in the synthetic world, m/s^2.
inline const Eigen::Vector3d kGravityInWorld(0, 0, -9.81);

// The exact motion of the body at one time.
struct BodyState {
  std::int64_t timestamp_ns = 0;
  Rigid3 world_from_body;
  Eigen::Vector3d velocity_in_world = Eigen::Vector3d::Zero();         // m/s
  Eigen::Vector3d acceleration_in_world = Eigen::Vector3d::Zero();     // m/s^2, without gravity
  Eigen::Vector3d angular_velocity_in_body = Eigen::Vector3d::Zero();  // rad/s
};

// value(t) = offset + rate * t + sum of amplitude * sin(frequency * t + phase).
struct SmoothCurve {
  struct Wave {
    double amplitude = 0, frequency = 0, phase = 0;  // frequency in rad/s
  };
  double offset = 0, rate = 0;
  std::vector<Wave> waves;

  double Value(double t) const;
  double First(double t) const;   // first derivative
  double Second(double t) const;  // second derivative
};

// A smooth motion through the free places of SyntheticWorld with analytic derivatives, for any
// time. Each wobbles a little (seeded) about all axes, so that an IMU is excited.
class SyntheticTrajectory {
 public:
  // Once around the origin every `period` seconds, looking ahead; passes its start again exactly.
  static SyntheticTrajectory Loop(double period = 20, std::uint32_t seed = 1);
  // Along the aisle from x = -5.5 m at `speed` m/s: 11 m long.
  static SyntheticTrajectory Forward(double speed = 0.8, std::uint32_t seed = 1);
  // Forth and back along 7 m of the aisle every `period` seconds, for any duration, always looking
  // along +x; repeats exactly.
  static SyntheticTrajectory ForthAndBack(double period = 16, std::uint32_t seed = 1);

  // heading_from_body: the body's mounting (HeadingFromBody); start_ns: the time of t = 0.
  SyntheticTrajectory& Mount(const Eigen::Quaterniond& heading_from_body, std::int64_t start_ns);

  std::int64_t start_ns() const { return start_ns_; }
  BodyState At(std::int64_t timestamp_ns) const;
  // Evenly spaced states from start_ns on.
  std::vector<BodyState> Sample(double rate_hz, int count) const;

 private:
  SyntheticTrajectory() = default;
  // Waves whose frequencies are multiples of `base` (rad/s), so that the motion repeats with it.
  void AddWobble(double base, std::uint32_t seed);

  std::array<SmoothCurve, 3> position_;  // metres, in world
  std::array<SmoothCurve, 3> angles_;    // yaw, pitch, roll in radians: Rz(yaw) Ry(pitch) Rx(roll)
  Eigen::Quaterniond heading_from_body_ = Eigen::Quaterniond::Identity();
  std::int64_t start_ns_ = 0;
};

struct ImuSimulationOptions {
  ImuNoise noise;  // rate_hz > 0; densities of 0 give exact readings
  Eigen::Vector3d gyroscope_bias = Eigen::Vector3d::Zero();      // at the start, rad/s
  Eigen::Vector3d accelerometer_bias = Eigen::Vector3d::Zero();  // at the start, m/s^2
  std::uint32_t seed = 1;
};

// Readings and the biases that they hold, one each a sample.
struct ImuRecording {
  std::vector<ImuSample> samples;
  std::vector<Eigen::Vector3d> gyroscope_biases;      // rad/s
  std::vector<Eigen::Vector3d> accelerometer_biases;  // m/s^2
};

// What an IMU at the body's origin reads from begin_ns to end_ns (inclusive), sampled at the rate
// of the noise model: white noise of density / sqrt(dt), biases that walk with sigma * sqrt(dt).
ImuRecording SimulateImu(const SyntheticTrajectory& trajectory, std::int64_t begin_ns,
                         std::int64_t end_ns, const ImuSimulationOptions& options);

}  // namespace airslam
