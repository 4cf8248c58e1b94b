// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/inertial_filter.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "airslam/geometry/so3.h"

namespace airslam {
namespace {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Vector15d = Eigen::Matrix<double, 15, 1>;

// A pose cannot be known better than this (rad, m), so that covariances stay invertible.
constexpr double kSmallest = 1e-6;
// What the points leave open counts as known this badly (rad and m).
constexpr double kLargest = 10;

Matrix6d Diagonal(double rotation, double position) {
  Vector6d diagonal;
  diagonal << Eigen::Vector3d::Constant(rotation), Eigen::Vector3d::Constant(position);
  return diagonal.asDiagonal();
}

Matrix6d Inverse(const Matrix6d& symmetric) {
  return Eigen::LDLT<Matrix6d>(symmetric).solve(Matrix6d::Identity());
}

}  // namespace

InertialFilter::InertialFilter(std::int64_t timestamp_ns, const InertialState& state,
                               const Matrix15d& covariance, const Rigid3& body_from_cam)
    : timestamp_ns_(timestamp_ns),
      state_(state),
      covariance_(covariance),
      body_from_cam_(body_from_cam) {}

double InertialFilter::SigmaPosition() const {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(covariance_.block<3, 3>(6, 6),
                                                             Eigen::EigenvaluesOnly);
  return std::sqrt(std::max(0.0, eigen.eigenvalues().maxCoeff()));
}

void InertialFilter::Propagate(const ImuPreintegration& readings,
                               const Eigen::Vector3d& gravity_in_world) {
  covariance_ = PredictCovariance(state_, covariance_, readings);
  state_ = Predict(state_, readings, gravity_in_world);
  timestamp_ns_ = readings.samples().back().timestamp_ns;
}

Eigen::Matrix<double, 6, 15> InertialFilter::CameraByState() const {
  const Eigen::Matrix3d world_from_body = state_.world_from_body.rotation.toRotationMatrix();
  Eigen::Matrix<double, 6, 15> j = Eigen::Matrix<double, 6, 15>::Zero();
  j.block<3, 3>(0, 0) = body_from_cam_.rotation.conjugate().toRotationMatrix();
  j.block<3, 3>(3, 0) = -world_from_body * Skew(body_from_cam_.translation);
  j.block<3, 3>(3, 6).setIdentity();
  return j;
}

PosePrior InertialFilter::Prior() const {
  const Eigen::Matrix<double, 6, 15> j = CameraByState();
  const double smallest = kSmallest * kSmallest;
  return PosePrior::FromCovariance(world_from_cam(),
                                   j * covariance_ * j.transpose() + Diagonal(smallest, smallest));
}

// docs/inertial.md, "The filter".
void InertialFilter::Correct(const VisualPose& seen) {
  const Eigen::Matrix<double, 6, 15> j = CameraByState();
  const double smallest = kSmallest * kSmallest, least = 1 / (kLargest * kLargest);
  const Matrix6d prior = j * covariance_ * j.transpose() + Diagonal(smallest, smallest);
  const Matrix6d points = Inverse(seen.information + Diagonal(least, least));
  const Matrix6d vision = points + Diagonal(seen.floor_rotation * seen.floor_rotation,
                                            seen.floor_position * seen.floor_position);
  const Rigid3 predicted = world_from_cam();
  Vector6d moved;
  moved << LogSO3(predicted.rotation.conjugate() * seen.world_from_cam.rotation),
      seen.world_from_cam.translation - predicted.translation;
  // The optimized pose lies between the prediction and what the points alone would say.
  const Vector6d innovation = (prior + points) * Inverse(prior) * moved;
  const Eigen::Matrix<double, 15, 6> gain = covariance_ * j.transpose() * Inverse(prior + vision);
  const Vector15d change = gain * innovation;
  state_.world_from_body = seen.world_from_cam * body_from_cam_.Inverse();
  state_.velocity_in_world += change.segment<3>(3);
  state_.bias.gyroscope += change.segment<3>(9);
  state_.bias.accelerometer += change.segment<3>(12);
  // Joseph's form, which stays positive definite.
  const Matrix15d rest = Matrix15d::Identity() - gain * j;
  covariance_ = rest * covariance_ * rest.transpose() + gain * vision * gain.transpose();
}

}  // namespace airslam
