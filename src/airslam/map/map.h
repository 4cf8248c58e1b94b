// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <string>

#include "airslam/geometry/pinhole.h"
#include "airslam/map/keyframe.h"

namespace airslam {

// The calibration a map was made with: everything needed to use its pixels and poses.
struct MapCalibration {
  StereoCamera stereo;    // rectified
  Rigid3 body_from_left;  // rectified left camera to body
  bool has_imu = false;   // the body is an IMU frame
};

// Keyframes and landmarks by id, ordered, so that every walk over them repeats.
struct Map {
  MapCalibration calibration;
  std::string model_pack;         // name of the pack that made the descriptors
  std::string model_pack_sha256;  // of its feature network
  std::map<KeyframeId, Keyframe> keyframes;
  std::map<LandmarkId, Landmark> landmarks;           // points
  std::map<LandmarkId, LineLandmark> line_landmarks;  // numbered apart from the points
};

}  // namespace airslam
