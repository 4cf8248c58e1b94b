// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include "airslam/geometry/rigid3.h"
#include "airslam/map/keyframe.h"
#include "airslam/optimize/pose_prior_factor.h"

namespace airslam {

// Predicts the next camera pose by constant velocity. The last pose hangs on its keyframe, so that
// it follows when the keyframe is optimized.
class MotionModel {
 public:
  // Forgets the velocity: the next frame is expected where the last one was.
  void Reset() { has_velocity_ = false; }

  // The pose of a tracked frame, relative to keyframe `reference`, whose pose now is
  // `world_from_reference`.
  void Observe(std::int64_t timestamp_ns, KeyframeId reference, const Rigid3& reference_from_cam,
               const Rigid3& world_from_reference);

  // The last frame has itself become keyframe `reference`.
  void MoveTo(KeyframeId reference) {
    reference_ = reference;
    reference_from_last_ = {};
  }

  // The reference has moved, by bundle adjustment: so has the last frame.
  void Rebase(const Rigid3& world_from_reference) {
    world_from_last_ = world_from_reference * reference_from_last_;
  }

  // The keyframe that the last pose hangs on.
  KeyframeId reference() const { return reference_; }

  // Pose expected at a time after the last one. Its standard deviations are those of a motion that
  // changes by up to 10 m/s^2 and 10 rad/s^2, and very large without a velocity.
  PosePrior Predict(std::int64_t timestamp_ns, const Rigid3& world_from_reference) const;

 private:
  KeyframeId reference_ = -1;
  Rigid3 reference_from_last_;
  Rigid3 world_from_last_;
  std::int64_t last_timestamp_ns_ = 0;
  bool has_last_ = false;
  bool has_velocity_ = false;
  Eigen::Vector3d angular_velocity_ = Eigen::Vector3d::Zero();  // rad/s, camera frame
  Eigen::Vector3d velocity_ = Eigen::Vector3d::Zero();          // m/s, camera frame
};

}  // namespace airslam
