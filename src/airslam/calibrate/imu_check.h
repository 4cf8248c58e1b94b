// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include <optional>
#include <string>
#include <vector>

#include "airslam/calibrate/raw_matches.h"
#include "airslam/sensor/imu.h"
#include "airslam/sensor/rig.h"

namespace airslam {

// How the left camera turned between two images, by vision alone.
struct VisualTurn {
  std::int64_t from_ns = 0, to_ns = 0;               // image time
  Eigen::Vector3d vector = Eigen::Vector3d::Zero();  // Log(from_cam_from_to_cam), rad, raw camera
  double sigma = 0;                                  // rad, of the worst axis
};

// The turn of two-view geometry: the rotation of the best of several starts (the essential matrix
// by RANSAC; a pure rotation with each axis as direction of motion), fitted to the epipolar errors.
// Nothing with fewer than 30 points or when no start explains most of them.
std::optional<VisualTurn> EstimateTurn(const DistortedCamera& camera, const RawMotion& motion);

// The images' turns against the gyroscope's.
struct ImuCheck {
  std::string unknown;   // why there is no answer, a sentence; empty: there is one
  int turns = 0;         // that were compared
  double mean_turn = 0;  // rad, root mean square of the turns
  // Error of the calibrated time offset: time of the IMU = time of the image + calibrated + this,
  // seconds; sigma 0: the motion does not tell.
  double time_offset = 0, time_offset_sigma = 0;
  // The camera's orientation on the IMU against its calibration: body_from_cam = calibrated *
  // Exp(this), rad; sigma of the worst axis, 0: the motion does not tell.
  Eigen::Vector3d rotation = Eigen::Vector3d::Zero();
  double rotation_sigma = 0;
  // The images' turns over the gyroscope's: 1 for the right focal length.
  double turn_ratio = 0;
  Eigen::Vector3d gyroscope_bias = Eigen::Vector3d::Zero();  // rad/s, mean over the sequence
  double residual = 0;  // rad, robust standard deviation of a turn's difference
};

// Finds offset, rotation and bias together: for offsets of up to half a second either way, the
// rotation between the two lists of turns (Kabsch) and the bias that remain best; the least robust
// cost wins. The rotation counts only where the camera turned about more than one axis; else the
// calibrated one is kept. Needs 8 turns and at least 1 degree of turning.
ImuCheck CheckImu(const StereoRig& rig, const std::vector<ImuSample>& imu,
                  const std::vector<VisualTurn>& turns);

}  // namespace airslam
