// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include "airslam/optimize/pose_prior_factor.h"
#include "airslam/sensor/imu_preintegration.h"

namespace airslam {

// A camera pose that vision has found, for InertialFilter.
struct VisualPose {
  Rigid3 world_from_cam;  // optimized together with the filter's own Prior()
  // Inverse covariance as the points alone give it (PoseInformation).
  Matrix6d information = Matrix6d::Zero();
  // Standard deviations (rad, m) that every pose has on top: landmarks err too, and together.
  double floor_rotation = 0;
  double floor_position = 0;
};

// The state of the body at the latest frame, with its covariance: predicted by the IMU, corrected
// by the poses that vision finds (an iterated extended Kalman filter whose iterations are the
// motion-only optimization). Order of the errors: see PredictCovariance.
class InertialFilter {
 public:
  InertialFilter() = default;
  InertialFilter(std::int64_t timestamp_ns, const InertialState& state, const Matrix15d& covariance,
                 const Rigid3& body_from_cam);

  std::int64_t timestamp_ns() const { return timestamp_ns_; }
  const InertialState& state() const { return state_; }
  const Matrix15d& covariance() const { return covariance_; }
  Rigid3 world_from_cam() const { return state_.world_from_body * body_from_cam_; }
  // Standard deviation of the position in metres, in the direction that is known least.
  double SigmaPosition() const;

  // Moves on to the end of the readings, which begin at timestamp_ns().
  void Propagate(const ImuPreintegration& readings, const Eigen::Vector3d& gravity_in_world);

  // The camera's pose as predicted.
  PosePrior Prior() const;

  // Takes over what vision found at timestamp_ns(): the pose as it is, and what the difference from
  // the prediction says of velocity and biases.
  void Correct(const VisualPose& seen);

  // Puts another state in its place, known as well as before.
  void Replace(const InertialState& state) { state_ = state; }

 private:
  // Derivative of the camera pose's error (order of PosePrior) by that of the state.
  Eigen::Matrix<double, 6, 15> CameraByState() const;

  std::int64_t timestamp_ns_ = 0;
  InertialState state_;
  Matrix15d covariance_ = Matrix15d::Identity();
  Rigid3 body_from_cam_;
};

}  // namespace airslam
