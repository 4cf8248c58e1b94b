// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/testing/synthetic_motion.h"

#include <cmath>
#include <numbers>
#include <random>

#include "airslam/testing/synthetic_world.h"

namespace airslam {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kEyeHeight = 1.4;  // metres
constexpr double kAisle = -2.6;     // y of the aisle, metres
constexpr double kLoopRadius = 2.6;

Eigen::Vector3d RandomVector(double sigma, std::mt19937& random) {
  Eigen::Vector3d vector;
  for (int i = 0; i < 3; ++i) vector[i] = sigma * Normal(random);
  return vector;
}

}  // namespace

double SmoothCurve::Value(double t) const {
  double value = offset + rate * t;
  for (const Wave& wave : waves)
    value += wave.amplitude * std::sin(wave.frequency * t + wave.phase);
  return value;
}

double SmoothCurve::First(double t) const {
  double value = rate;
  for (const Wave& wave : waves) {
    value += wave.amplitude * wave.frequency * std::cos(wave.frequency * t + wave.phase);
  }
  return value;
}

double SmoothCurve::Second(double t) const {
  double value = 0;
  for (const Wave& wave : waves) {
    value -= wave.amplitude * wave.frequency * wave.frequency *
             std::sin(wave.frequency * t + wave.phase);
  }
  return value;
}

void SyntheticTrajectory::AddWobble(double base, std::uint32_t seed) {
  std::mt19937 random(seed);
  const auto add = [&](SmoothCurve& curve, double amplitude, double hertz) {
    const double multiple = std::max(1.0, std::round(2 * kPi * hertz / base));
    curve.waves.push_back(
        {amplitude * Uniform(random, 0.7, 1.3), multiple * base, Uniform(random, 0, 2 * kPi)});
  };
  add(position_[0], 0.03, 0.35);
  add(position_[1], 0.05, 0.25);
  add(position_[2], 0.12, 0.30);
  add(position_[2], 0.02, 0.90);
  add(angles_[0], 0.06, 0.20);
  add(angles_[1], 0.04, 0.30);
  add(angles_[1], 0.01, 1.00);
  add(angles_[2], 0.04, 0.40);
}

SyntheticTrajectory SyntheticTrajectory::Loop(double period, std::uint32_t seed) {
  SyntheticTrajectory trajectory;
  const double omega = 2 * kPi / period;
  trajectory.position_[0].waves.push_back({kLoopRadius, omega, kPi / 2});
  trajectory.position_[1].waves.push_back({kLoopRadius, omega, 0});
  trajectory.position_[2].offset = kEyeHeight;
  trajectory.angles_[0].offset = kPi / 2;
  trajectory.angles_[0].rate = omega;
  trajectory.AddWobble(omega, seed);
  return trajectory;
}

SyntheticTrajectory SyntheticTrajectory::Forward(double speed, std::uint32_t seed) {
  SyntheticTrajectory trajectory;
  trajectory.position_[0].offset = -5.5;
  trajectory.position_[0].rate = speed;
  trajectory.position_[1].offset = kAisle;
  trajectory.position_[2].offset = kEyeHeight;
  trajectory.AddWobble(2 * kPi / 20, seed);
  return trajectory;
}

SyntheticTrajectory SyntheticTrajectory::ForthAndBack(double period, std::uint32_t seed) {
  SyntheticTrajectory trajectory;
  const double omega = 2 * kPi / period;
  trajectory.position_[0].waves.push_back({3.5, omega, -kPi / 2});
  trajectory.position_[1].offset = kAisle;
  trajectory.position_[2].offset = kEyeHeight;
  trajectory.AddWobble(omega, seed);
  return trajectory;
}

SyntheticTrajectory& SyntheticTrajectory::Mount(const Eigen::Quaterniond& heading_from_body,
                                                std::int64_t start_ns) {
  heading_from_body_ = heading_from_body.normalized();
  start_ns_ = start_ns;
  return *this;
}

BodyState SyntheticTrajectory::At(std::int64_t timestamp_ns) const {
  const double t = 1e-9 * static_cast<double>(timestamp_ns - start_ns_);
  BodyState state;
  state.timestamp_ns = timestamp_ns;
  Eigen::Vector3d position;
  for (int i = 0; i < 3; ++i) {
    position[i] = position_[i].Value(t);
    state.velocity_in_world[i] = position_[i].First(t);
    state.acceleration_in_world[i] = position_[i].Second(t);
  }
  const double pitch = angles_[1].Value(t), roll = angles_[2].Value(t);
  const Eigen::Quaterniond world_from_heading =
      Eigen::AngleAxisd(angles_[0].Value(t), Eigen::Vector3d::UnitZ()) *
      Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitY()) *
      Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitX());
  state.world_from_body = Rigid3(world_from_heading * heading_from_body_, position);
  // Rates of the Euler angles to the angular velocity in the turned frame.
  const double yaw_rate = angles_[0].First(t), pitch_rate = angles_[1].First(t);
  const Eigen::Vector3d omega_in_heading(
      angles_[2].First(t) - yaw_rate * std::sin(pitch),
      pitch_rate * std::cos(roll) + yaw_rate * std::cos(pitch) * std::sin(roll),
      -pitch_rate * std::sin(roll) + yaw_rate * std::cos(pitch) * std::cos(roll));
  state.angular_velocity_in_body = heading_from_body_.conjugate() * omega_in_heading;
  return state;
}

std::vector<BodyState> SyntheticTrajectory::Sample(double rate_hz, int count) const {
  std::vector<BodyState> states;
  for (int i = 0; i < count; ++i) states.push_back(At(start_ns_ + std::llround(i * 1e9 / rate_hz)));
  return states;
}

ImuRecording SimulateImu(const SyntheticTrajectory& trajectory, std::int64_t begin_ns,
                         std::int64_t end_ns, const ImuSimulationOptions& options) {
  const ImuNoise& noise = options.noise;
  const double dt = 1.0 / noise.rate_hz;
  std::mt19937 random(options.seed);
  Eigen::Vector3d gyroscope_bias = options.gyroscope_bias;
  Eigen::Vector3d accelerometer_bias = options.accelerometer_bias;
  ImuRecording recording;
  for (std::int64_t i = 0;; ++i) {
    const std::int64_t time = begin_ns + std::llround(static_cast<double>(i) * 1e9 * dt);
    if (time > end_ns) break;
    const BodyState state = trajectory.At(time);
    const Eigen::Vector3d specific_force = state.world_from_body.rotation.conjugate() *
                                           (state.acceleration_in_world - kGravityInWorld);
    const double white = 1.0 / std::sqrt(dt), walk = std::sqrt(dt);
    ImuSample sample;
    sample.timestamp_ns = time;
    sample.angular_velocity = state.angular_velocity_in_body + gyroscope_bias +
                              RandomVector(noise.gyroscope_noise_density * white, random);
    sample.acceleration = specific_force + accelerometer_bias +
                          RandomVector(noise.accelerometer_noise_density * white, random);
    recording.samples.push_back(sample);
    recording.gyroscope_biases.push_back(gyroscope_bias);
    recording.accelerometer_biases.push_back(accelerometer_bias);
    gyroscope_bias += RandomVector(noise.gyroscope_random_walk * walk, random);
    accelerometer_bias += RandomVector(noise.accelerometer_random_walk * walk, random);
  }
  return recording;
}

}  // namespace airslam
