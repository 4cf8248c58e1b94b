// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/motion_model.h"

#include "airslam/geometry/so3.h"

namespace airslam {
namespace {

// Beyond this a constant velocity says nothing about a robot's motion.
constexpr double kMaxExtrapolation = 0.5;  // seconds

}  // namespace

void MotionModel::Observe(std::int64_t timestamp_ns, KeyframeId reference,
                          const Rigid3& reference_from_cam, const Rigid3& world_from_reference) {
  const Rigid3 world_from_cam = world_from_reference * reference_from_cam;
  const double seconds = 1e-9 * static_cast<double>(timestamp_ns - last_timestamp_ns_);
  has_velocity_ = has_last_ && seconds > 0 && seconds <= kMaxExtrapolation;
  if (has_velocity_) {
    const Rigid3 last_from_cam = world_from_last_.Inverse() * world_from_cam;
    angular_velocity_ = LogSO3(last_from_cam.rotation) / seconds;
    velocity_ = last_from_cam.translation / seconds;
  }
  reference_ = reference;
  reference_from_last_ = reference_from_cam;
  world_from_last_ = world_from_cam;
  last_timestamp_ns_ = timestamp_ns;
  has_last_ = true;
}

PosePrior MotionModel::Predict(std::int64_t timestamp_ns,
                               const Rigid3& world_from_reference) const {
  constexpr double kUnknown = 1e3;        // radians, metres
  constexpr double kChange = 10;          // m/s^2, rad/s^2
  constexpr double kVelocityNoise = 0.1;  // m/s, rad/s: of the velocity itself
  const Rigid3 world_from_last = world_from_reference * reference_from_last_;
  const double seconds = 1e-9 * static_cast<double>(timestamp_ns - last_timestamp_ns_);
  if (!has_velocity_ || seconds > kMaxExtrapolation) return {world_from_last, kUnknown, kUnknown};
  const double sigma = 0.5 * kChange * seconds * seconds + kVelocityNoise * seconds;
  return {world_from_last *
              Rigid3(ExpSO3(angular_velocity_ * seconds), Eigen::Vector3d(velocity_ * seconds)),
          sigma, sigma};
}

}  // namespace airslam
