// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include <array>
#include <span>
#include <vector>

#include "airslam/calibrate/raw_matches.h"
#include "airslam/sensor/rig.h"

namespace airslam {

// A change of a calibrated rig that two-view geometry can see. (The length of the baseline is not
// among them: pictures of a small rig in a small world and of a large one in a large world are the
// same.)
struct RigCorrection {
  // The right camera is turned by these against its calibration, rad about its x, y and z (right,
  // down, forward): body_from_right = calibrated body_from_right * Exp(turn).
  Eigen::Vector3d turn = Eigen::Vector3d::Zero();
  // The baseline's direction is turned by these, rad about two axes across it.
  Eigen::Vector2d direction = Eigen::Vector2d::Zero();
  // A ray's distance from the optical axis (on z = 1) is r (1 + a1 r^2 + a2 r^4 + a3 r^6), not r.
  std::array<double, 3> left_radial = {0, 0, 0}, right_radial = {0, 0, 0};
  // The right image is taken so much later than the left one, seconds.
  double delay = 0;

  static constexpr int kParameters = 12;
  double& at(int parameter);  // in the order above
};

// A match as rays in the two calibrated cameras, on z = 1.
struct RayMatch {
  bool valid = false;  // both pixels lie where the distortion is invertible
  Eigen::Vector3d left, right;
  bool has_velocity = false;
  Eigen::Vector3d right_per_second = Eigen::Vector3d::Zero();
};

// The rays of all matches under the rig's cameras, in the same order. The right pixel is taken to
// move as the left one does.
std::vector<RayMatch> ToRays(const StereoRig& rig, std::span<const RawMatch> matches);

// How a match fits the geometry of two views.
struct EpipolarError {
  // Distance from the epipolar line in pixels of the mean focal length, signed: what the vertical
  // disparity of the rectified images is. (With E = [t]x R and e = r' E l, it is e over the root
  // mean square of its gradients in both images: sqrt(2) times Sampson's distance. In rectified
  // images both gradients are 1.)
  double pixels = 0;
  // Angle between the two rays in pixels, positive when they meet in front of both cameras.
  double parallax = 0;
};

// The geometry of a rig, corrected.
class EpipolarGeometry {
 public:
  EpipolarGeometry(const StereoRig& rig, const RigCorrection& correction);
  // Of a valid match.
  EpipolarError Error(const RayMatch& match) const;

  double focal() const { return focal_; }  // pixels

 private:
  RigCorrection correction_;
  Eigen::Matrix3d turn_;             // calibrated right camera from the turned one
  Eigen::Matrix3d right_from_left_;  // rotation
  Eigen::Vector3d baseline_;         // the left camera in the right one, unit length
  double focal_;
};

}  // namespace airslam
