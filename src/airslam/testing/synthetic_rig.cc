// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/testing/synthetic_rig.h"

#include "airslam/geometry/so3.h"

namespace airslam {
namespace {

// EuRoC's noise densities (ADIS16448).
ImuNoise EurocImuNoise() {
  ImuNoise noise;
  noise.gyroscope_noise_density = 1.6968e-4;
  noise.gyroscope_random_walk = 1.9393e-5;
  noise.accelerometer_noise_density = 2.0e-3;
  noise.accelerometer_random_walk = 3.0e-3;
  noise.rate_hz = 200;
  return noise;
}

// body (x up, y right, z forward) from a camera (x right, y down, z forward) that is level.
Eigen::Quaterniond BodyFromLevelCamera() {
  Eigen::Matrix3d rotation;
  rotation << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  return Eigen::Quaterniond(rotation);
}

Pinhole IdealPinhole(int width, int height) {
  return {0.61 * width, 0.62 * width, 0.5 * width - 3.2, 0.5 * height + 1.7, width, height};
}

}  // namespace

StereoRig IdealRig(int width, int height) {
  StereoRig rig;
  rig.left.camera.pinhole = IdealPinhole(width, height);
  rig.right.camera = rig.left.camera;
  const Eigen::Quaterniond tilt = ExpSO3({0.02, -0.01, 0.015});
  rig.left.body_from_cam = {BodyFromLevelCamera() * tilt, {-0.022, -0.065, 0.010}};
  rig.right.body_from_cam =
      rig.left.body_from_cam * Rigid3(Eigen::Quaterniond::Identity(), {0.11, 0, 0});
  rig.imu = EurocImuNoise();
  rig.already_rectified = true;
  return rig;
}

StereoRig EurocLikeRig(int width, int height) {
  StereoRig rig;
  const double x = width / 752.0, y = height / 480.0;
  rig.left.camera.pinhole = {458.654 * x, 457.296 * y, 367.215 * x, 248.375 * y, width, height};
  rig.left.camera.model = Distortion::kRadialTangential;
  rig.left.camera.coefficients = {-0.28, 0.07, 2.0e-4, 2.0e-5};
  rig.right.camera.pinhole = {457.587 * x, 456.134 * y, 379.999 * x, 255.238 * y, width, height};
  rig.right.camera.model = Distortion::kRadialTangential;
  rig.right.camera.coefficients = {-0.278, 0.069, -1.0e-4, -3.0e-5};
  rig.left.body_from_cam = {BodyFromLevelCamera() * ExpSO3({0.0256, 0.0041, 0.0149}),
                            {-0.0216, -0.0647, 0.0098}};
  rig.right.body_from_cam =
      rig.left.body_from_cam * Rigid3(ExpSO3({0.011, -0.007, 0.005}), {0.11, -0.0005, 0.0009});
  rig.imu = EurocImuNoise();
  return rig;
}

StereoRig KittiLikeRig(int width, int height) {
  StereoRig rig;
  rig.left.camera.pinhole = IdealPinhole(width, height);
  rig.left.camera.pinhole.fy = rig.left.camera.pinhole.fx;
  rig.right.camera = rig.left.camera;
  rig.right.body_from_cam.translation = {0.5, 0, 0};
  rig.already_rectified = true;
  return rig;
}

Eigen::Quaterniond HeadingFromBody(const StereoRig& rig) {
  Eigen::Matrix3d heading_from_cam;
  heading_from_cam << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  return (Eigen::Quaterniond(heading_from_cam) * rig.left.body_from_cam.rotation.conjugate())
      .normalized();
}

}  // namespace airslam
