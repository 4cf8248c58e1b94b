// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstdint>
#include <vector>

#include "airslam/geometry/rigid3.h"
#include "airslam/sensor/imu.h"

namespace airslam {

// What the readings hold too much: true value = reading - bias.
struct ImuBias {
  Eigen::Vector3d gyroscope = Eigen::Vector3d::Zero();      // rad/s
  Eigen::Vector3d accelerometer = Eigen::Vector3d::Zero();  // m/s^2
};

// Motion from time i to time j as the body at i feels it, without gravity and start velocity.
struct ImuDelta {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();  // body_i from body_j
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();            // m/s, in body_i
  Eigen::Vector3d position = Eigen::Vector3d::Zero();            // m, in body_i
};

using Matrix9d = Eigen::Matrix<double, 9, 9>;
using Matrix96d = Eigen::Matrix<double, 9, 6>;
using Matrix15d = Eigen::Matrix<double, 15, 15>;

// Preintegrated readings between two times (paper, section V-E.3; Forster et al., "On-Manifold
// Preintegration for Real-Time Visual-Inertial Odometry", 2017). Vectors of errors have the order
// (rotation, velocity, position), where the rotation's error d is that of the right: true rotation
// = rotation * Exp(d).
//
// Between two readings the angular velocity is their mean and the acceleration, turned into the
// frame of time i, runs linearly from one to the other. (The paper and Forster hold each reading
// constant, which is of first order in the step only: this is of second.)
//
// Covariance: white noise of both sensors, and the walk of the biases away from those at time i.
class ImuPreintegration {
 public:
  ImuPreintegration() = default;
  // Samples in order of time, the first at time i, the last at time j (ImuBuffer::Between).
  ImuPreintegration(std::vector<ImuSample> samples, const ImuNoise& noise, const ImuBias& bias);

  double duration() const { return duration_; }     // seconds
  const ImuDelta& delta() const { return delta_; }  // at bias()
  const ImuBias& bias() const { return bias_; }     // where it is linearised
  const ImuNoise& noise() const { return noise_; }
  const std::vector<ImuSample>& samples() const { return samples_; }
  const Matrix9d& covariance() const { return covariance_; }
  // Covariance of the same errors with the change of the biases (gyroscope, accelerometer).
  const Matrix96d& bias_covariance() const { return bias_covariance_; }
  // Derivative by the biases (gyroscope, accelerometer).
  const Matrix96d& by_bias() const { return by_bias_; }

  // To first order in the change of the biases; exact in the accelerometer's.
  ImuDelta Corrected(const ImuBias& bias) const;

  // True when the first order no longer does: the change of the gyroscope's bias turns the body by
  // more than `max_turn` radians in the duration. (0.01 rad leave about g duration max_turn^2 / 2 =
  // 5e-4 m/s after a second.)
  bool IsFar(const ImuBias& bias, double max_turn = 0.01) const;

  // Integrates the samples again at other biases.
  void Reintegrate(const ImuBias& bias);

 private:
  void AddStep(const ImuSample& from, const ImuSample& to);

  std::vector<ImuSample> samples_;
  ImuNoise noise_;
  ImuBias bias_;
  double duration_ = 0;
  ImuDelta delta_;
  Matrix9d covariance_ = Matrix9d::Zero();
  Matrix96d bias_covariance_ = Matrix96d::Zero();
  Matrix96d by_bias_ = Matrix96d::Zero();
};

// How the gyroscope says that the body turned from the first of the samples to the last (body at
// the first from body at the last), by the rule of ImuPreintegration; `bias` in rad/s.
Eigen::Quaterniond GyroscopeTurn(const std::vector<ImuSample>& samples,
                                 const Eigen::Vector3d& bias);

// One preintegration over two that follow each other, at the bias of the first. Throws Error when
// they do not meet in time.
ImuPreintegration Join(const ImuPreintegration& first, const ImuPreintegration& second);

// The state of the body at one time.
struct InertialState {
  Rigid3 world_from_body;
  Eigen::Vector3d velocity_in_world = Eigen::Vector3d::Zero();  // m/s
  ImuBias bias;
};

// The state at the end of the preintegration from the one at its begin. Gravity points down
// (-z times 9.81 m/s^2 in a world whose z is up).
InertialState Predict(const InertialState& start, const ImuPreintegration& preintegration,
                      const Eigen::Vector3d& gravity_in_world);

// Covariance of the predicted state from that of the start. Order: rotation (right, in the body,
// rad), velocity, position (both in world), gyroscope's bias, accelerometer's bias.
Matrix15d PredictCovariance(const InertialState& start, const Matrix15d& covariance,
                            const ImuPreintegration& preintegration);

}  // namespace airslam
