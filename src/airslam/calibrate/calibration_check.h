// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "airslam/calibrate/imu_check.h"
#include "airslam/calibrate/rig_faults.h"

namespace airslam {

// What a calibration and the data of a sequence say about each other.
struct CalibrationReport {
  bool right = false;
  std::string fault;     // a word for programs: "none", "swapped", "time offset", ...
  std::string sentence;  // one: what is wrong, or that nothing is

  RawMatches matches;
  RigDiagnosis rig;
  double focal = 0;     // pixels, mean of both cameras
  double baseline = 0;  // metres, as calibrated; its length cannot be seen in images
  bool has_imu = false;
  ImuCheck imu;
  double calibrated_time_offset = 0;  // s
  ImuNoise calibrated_noise, measured_noise;
};

// Checks the calibration of a sequence (EuRoC, Kalibr, KITTI alike) on its own images and IMU
// readings: matches raw images (MatchRawImages), judges the two cameras (DiagnoseRig), then the
// camera on the IMU (CheckImu). The sentence names the gravest fault: cameras first.
//
// The IMU's time offset is wrong above 5 ms and 4 standard deviations, as for the odometry
// (InertialInitializationOptions); the camera's orientation on it when it is off by 4 standard
// deviations and tilts gravity by more than two standard deviations of the accelerometer's bias.
CalibrationReport CheckCalibration(const Sequence& sequence, FeatureDetector& detector,
                                   FeatureMatcher& matcher, const RawMatchOptions& options = {});

// The report as text for people, ending with the sentence, and for programs (docs/calibration.md).
std::string FormatCalibrationReport(const CalibrationReport& report);
nlohmann::json CalibrationReportToJson(const CalibrationReport& report);

}  // namespace airslam
