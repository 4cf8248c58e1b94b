// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/sensor/imu_preintegration.h"

#include <utility>

#include "airslam/common/error.h"
#include "airslam/geometry/so3.h"
#include "airslam/geometry/so3_jacobians.h"

namespace airslam {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

double Square(double x) { return x * x; }

// (gyroscope, accelerometer) on the diagonal.
Eigen::Matrix<double, 6, 6> Diagonal(double gyroscope, double accelerometer) {
  Eigen::Matrix<double, 6, 1> diagonal;
  diagonal << Vector3d::Constant(gyroscope), Vector3d::Constant(accelerometer);
  return diagonal.asDiagonal();
}

}  // namespace

ImuPreintegration::ImuPreintegration(std::vector<ImuSample> samples, const ImuNoise& noise,
                                     const ImuBias& bias)
    : samples_(std::move(samples)), noise_(noise) {
  Reintegrate(bias);
}

void ImuPreintegration::Reintegrate(const ImuBias& bias) {
  bias_ = bias;
  duration_ = 0;
  delta_ = {};
  covariance_.setZero();
  bias_covariance_.setZero();
  by_bias_.setZero();
  for (std::size_t k = 1; k < samples_.size(); ++k) AddStep(samples_[k - 1], samples_[k]);
}

// docs/factors.md, "Inertial".
void ImuPreintegration::AddStep(const ImuSample& from, const ImuSample& to) {
  const double dt = 1e-9 * static_cast<double>(to.timestamp_ns - from.timestamp_ns);
  if (dt <= 0) return;
  const Vector3d turn =
      dt * (0.5 * (from.angular_velocity + to.angular_velocity) - bias_.gyroscope);
  const Eigen::Quaterniond step = ExpSO3(turn);
  const Eigen::Quaterniond next = (delta_.rotation * step).normalized();
  const Matrix3d r0 = delta_.rotation.toRotationMatrix(), r1 = next.toRotationMatrix();
  const Vector3d a0 = from.acceleration - bias_.accelerometer;
  const Vector3d a1 = to.acceleration - bias_.accelerometer;

  // Errors after the step by those before it (a) and by the biases during it (b).
  const Matrix3d turned = step.conjugate().toRotationMatrix();
  const Matrix3d turn_by_bias = -dt * RightJacobian(turn);
  const Matrix3d pull0 = -r0 * Skew(a0), pull1 = -r1 * Skew(a1);
  Matrix9d a = Matrix9d::Identity();
  a.block<3, 3>(0, 0) = turned;
  a.block<3, 3>(3, 0) = dt / 2 * (pull0 + pull1 * turned);
  a.block<3, 3>(6, 0) = dt * dt / 6 * (2 * pull0 + pull1 * turned);
  a.block<3, 3>(6, 3) = dt * Matrix3d::Identity();
  Matrix96d b = Matrix96d::Zero();
  b.block<3, 3>(0, 0) = turn_by_bias;
  b.block<3, 3>(3, 0) = dt / 2 * pull1 * turn_by_bias;
  b.block<3, 3>(6, 0) = dt * dt / 6 * pull1 * turn_by_bias;
  b.block<3, 3>(3, 3) = -dt / 2 * (r0 + r1);
  b.block<3, 3>(6, 3) = -dt * dt / 6 * (2 * r0 + r1);

  const auto white = Diagonal(Square(noise_.gyroscope_noise_density) / dt,
                              Square(noise_.accelerometer_noise_density) / dt);
  const auto walked = Diagonal(Square(noise_.gyroscope_random_walk) * duration_,
                               Square(noise_.accelerometer_random_walk) * duration_);
  const Matrix9d cross = a * bias_covariance_ * b.transpose();
  covariance_ = a * covariance_ * a.transpose() + cross + cross.transpose() +
                b * (white + walked) * b.transpose();
  bias_covariance_ = a * bias_covariance_ + b * walked;
  by_bias_ = a * by_bias_ + b;

  delta_.position += dt * delta_.velocity + dt * dt / 6 * (2 * (r0 * a0) + r1 * a1);
  delta_.velocity += dt / 2 * (r0 * a0 + r1 * a1);
  delta_.rotation = next;
  duration_ += dt;
}

ImuDelta ImuPreintegration::Corrected(const ImuBias& bias) const {
  Eigen::Matrix<double, 6, 1> change;
  change << bias.gyroscope - bias_.gyroscope, bias.accelerometer - bias_.accelerometer;
  const Eigen::Matrix<double, 9, 1> correction = by_bias_ * change;
  return {delta_.rotation * ExpSO3(correction.head<3>()),
          delta_.velocity + correction.segment<3>(3), delta_.position + correction.tail<3>()};
}

bool ImuPreintegration::IsFar(const ImuBias& bias, double max_turn) const {
  return (bias.gyroscope - bias_.gyroscope).norm() * duration_ > max_turn;
}

Eigen::Quaterniond GyroscopeTurn(const std::vector<ImuSample>& samples,
                                 const Eigen::Vector3d& bias) {
  Eigen::Quaterniond turn = Eigen::Quaterniond::Identity();
  for (std::size_t k = 1; k < samples.size(); ++k) {
    const ImuSample &from = samples[k - 1], &to = samples[k];
    const double dt = 1e-9 * static_cast<double>(to.timestamp_ns - from.timestamp_ns);
    turn = turn * ExpSO3(dt * (0.5 * (from.angular_velocity + to.angular_velocity) - bias));
  }
  return turn;
}

ImuPreintegration Join(const ImuPreintegration& first, const ImuPreintegration& second) {
  if (first.samples().empty() || second.samples().empty() ||
      first.samples().back().timestamp_ns != second.samples().front().timestamp_ns) {
    Fail("two preintegrations can only be joined where one ends and the other begins");
  }
  std::vector<ImuSample> samples = first.samples();
  samples.insert(samples.end(), second.samples().begin() + 1, second.samples().end());
  return {std::move(samples), first.noise(), first.bias()};
}

InertialState Predict(const InertialState& start, const ImuPreintegration& preintegration,
                      const Eigen::Vector3d& gravity_in_world) {
  const double t = preintegration.duration();
  const ImuDelta delta = preintegration.Corrected(start.bias);
  const Rigid3& pose = start.world_from_body;
  InertialState end;
  end.world_from_body = Rigid3(pose.rotation * delta.rotation,
                               pose.translation + t * start.velocity_in_world +
                                   0.5 * t * t * gravity_in_world + pose.rotation * delta.position);
  end.velocity_in_world =
      start.velocity_in_world + t * gravity_in_world + pose.rotation * delta.velocity;
  end.bias = start.bias;
  return end;
}

Matrix15d PredictCovariance(const InertialState& start, const Matrix15d& covariance,
                            const ImuPreintegration& preintegration) {
  const double t = preintegration.duration();
  const ImuDelta delta = preintegration.Corrected(start.bias);
  const Matrix3d r = start.world_from_body.rotation.toRotationMatrix();
  Matrix9d to_world = Matrix9d::Identity();  // of the preintegration's errors
  to_world.block<3, 3>(3, 3) = r;
  to_world.block<3, 3>(6, 6) = r;
  Matrix15d f = Matrix15d::Identity();
  f.block<3, 3>(0, 0) = delta.rotation.conjugate().toRotationMatrix();
  f.block<3, 3>(3, 0) = -r * Skew(delta.velocity);
  f.block<3, 3>(6, 0) = -r * Skew(delta.position);
  f.block<3, 3>(6, 3) = t * Matrix3d::Identity();
  f.topRightCorner<9, 6>() = to_world * preintegration.by_bias();
  const ImuNoise& noise = preintegration.noise();
  Matrix15d q;
  q.topLeftCorner<9, 9>() = to_world * preintegration.covariance() * to_world.transpose();
  q.topRightCorner<9, 6>() = to_world * preintegration.bias_covariance();
  q.bottomLeftCorner<6, 9>() = q.topRightCorner<9, 6>().transpose();
  q.bottomRightCorner<6, 6>() = Diagonal(Square(noise.gyroscope_random_walk) * t,
                                         Square(noise.accelerometer_random_walk) * t);
  return f * covariance * f.transpose() + q;
}

}  // namespace airslam
