// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "airslam/geometry/so3.h"
#include "airslam/sensor/rig.h"

// Calibrations that the tests of this layer share.
namespace airslam {

// cam0 of EuRoC's machine hall and Vicon room sequences.
inline DistortedCamera EurocCamera() {
  DistortedCamera camera;
  camera.pinhole = {458.654, 457.296, 367.215, 248.375, 752, 480};
  camera.model = Distortion::kRadialTangential;
  camera.coefficients = {-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05};
  return camera;
}

// A fisheye lens like TUM-VI's: about 190 degrees across the image circle.
inline DistortedCamera FisheyeCamera() {
  DistortedCamera camera;
  camera.pinhole = {190.978, 190.973, 254.932, 256.897, 512, 512};
  camera.model = Distortion::kEquidistant;
  camera.coefficients = {0.0034823894, 0.0007150348, -0.0020532361, 0.00020293673};
  return camera;
}

// The rendered warehouse: the body is the IMU, the right camera is turned by 0.8 degrees.
inline StereoRig WarehouseRig() {
  StereoRig rig;
  rig.left.camera.pinhole = {458.654, 457.296, 367.215, 248.375, 752, 480};
  rig.left.camera.model = Distortion::kRadialTangential;
  rig.left.camera.coefficients = {-0.28, 0.07, 0.0002, 2e-05};
  Eigen::Matrix4d matrix;
  matrix << -0.0149502556418457, -0.999880598897571, -0.00390868321539486, -0.0216,  //
      0.999561347687639, -0.014845303462707, -0.0256267277265759, -0.0647,           //
      0.0255656422785616, -0.00429009479324043, 0.999663940042627, 0.0098,           //
      0, 0, 0, 1;
  rig.left.body_from_cam = Rigid3::FromMatrix(matrix);
  rig.right.camera.pinhole = {457.587, 456.134, 379.999, 255.238, 752, 480};
  rig.right.camera.model = Distortion::kRadialTangential;
  rig.right.camera.coefficients = {-0.278, 0.069, -0.0001, -3e-05};
  matrix << -0.00991705082643497, -0.999947302736518, 0.00265402578527102, -0.0236428484391539,  //
      0.999847101258008, -0.00995421504863232, -0.0143766376014727, 0.0453662676412052,          //
      0.0144022987354243, 0.00251104614226019, 0.999893128508446, 0.0118133300249182,            //
      0, 0, 0, 1;
  rig.right.body_from_cam = Rigid3::FromMatrix(matrix);
  return rig;
}

// Two fisheye cameras, the right one turned by 4 degrees; the body is the left camera.
inline StereoRig FisheyeRig() {
  StereoRig rig;
  rig.left.camera = FisheyeCamera();
  rig.right.camera = FisheyeCamera();
  rig.right.camera.pinhole.cx += 3;
  rig.right.body_from_cam = Rigid3(ExpSO3({0.03, -0.05, 0.04}), {0.101, 0.002, 0.001});
  return rig;
}

}  // namespace airslam
