// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/calibrate/calibration_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "airslam/optimize/inertial_initialization.h"
#include "airslam/sensor/imu_noise.h"

namespace airslam {
namespace {

constexpr double kDegrees = 180 / std::numbers::pi;

// Frames of the tries with shifted right images: few suffice.
constexpr int kShiftedFrames = 8;

ImuCheck CheckTurns(const Sequence& sequence, const RawMatches& matches) {
  std::vector<VisualTurn> turns;
  for (const RawMotion& motion : matches.motions) {
    if (const auto turn = EstimateTurn(sequence.rig().left.camera, motion)) turns.push_back(*turn);
  }
  return CheckImu(sequence.rig(), sequence.imu(), turns);
}

void JudgeTimeOffset(CalibrationReport& report) {
  const double allowed = InertialInitializationOptions().max_time_offset;
  const ImuCheck& imu = report.imu;
  if (imu.time_offset_sigma <= 0 ||
      std::abs(imu.time_offset) <= std::max(allowed, 4 * imu.time_offset_sigma)) {
    return;
  }
  report.fault = "time offset";
  report.sentence = fmt::format(
      "unsynchronised IMU: its clock is {:.1f} ms {} of the images' (standard deviation {:.1f} "
      "ms), the calibration says {:+.1f} ms: set the offset to {:+.1f} ms",
      1e3 * std::abs(report.calibrated_time_offset + imu.time_offset),
      report.calibrated_time_offset + imu.time_offset > 0 ? "ahead" : "behind",
      1e3 * imu.time_offset_sigma, 1e3 * report.calibrated_time_offset,
      1e3 * (report.calibrated_time_offset + imu.time_offset));
}

void JudgeRotation(CalibrationReport& report) {
  const InertialInitializationOptions tolerance;
  const double allowed = 2 * tolerance.sigma_accelerometer_bias / tolerance.gravity;
  const ImuCheck& imu = report.imu;
  const double angle = imu.rotation.norm();
  if (imu.rotation_sigma <= 0 || angle <= std::max(allowed, 4 * imu.rotation_sigma)) return;
  report.fault = "IMU extrinsic";
  report.sentence = fmt::format(
      "wrong or inverted extrinsic of the IMU: the camera turns about axes that are {:.1f} degrees "
      "off those that the gyroscope and the calibration say (standard deviation {:.1f} degrees)",
      kDegrees * angle, kDegrees * imu.rotation_sigma);
}

std::string RightSentence(const CalibrationReport& report) {
  std::string sentence = fmt::format(
      "nothing is wrong: the rows of left and right images agree within {:.2f} px (median of {} "
      "matches)",
      AbsoluteQuantile(report.rig.calibrated.pixels, 0.5), report.rig.calibrated.size());
  if (report.has_imu && report.imu.unknown.empty()) {
    sentence += fmt::format(", the IMU's clock with the images' within {:.1f} ms",
                            1e3 * std::abs(report.imu.time_offset));
  }
  if (report.has_imu && !report.imu.unknown.empty()) {
    sentence += ", but the IMU was not compared: " + report.imu.unknown;
  }
  return sentence;
}

void Judge(CalibrationReport& report) {
  report.fault = ToString(report.rig.fault);
  report.sentence = report.rig.sentence;
  if (report.rig.fault != RigFault::kNone) return;
  // A wrong orientation spoils nothing of the time offset, which finds the orientation itself.
  if (report.has_imu && report.imu.unknown.empty()) {
    JudgeRotation(report);
    if (report.fault == "none") JudgeTimeOffset(report);
  }
  report.right = report.fault == "none";
  if (report.right) report.sentence = RightSentence(report);
}

}  // namespace

CalibrationReport CheckCalibration(const Sequence& sequence, FeatureDetector& detector,
                                   FeatureMatcher& matcher, const RawMatchOptions& options) {
  CalibrationReport report;
  const StereoRig& rig = sequence.rig();
  report.focal = EpipolarGeometry(rig, {}).focal();
  report.baseline = rig.Baseline();
  report.matches = MatchRawImages(sequence, detector, matcher, options);
  RawMatchOptions few = options;
  few.frames = std::min(few.frames, kShiftedFrames);
  report.rig = DiagnoseRig(rig, report.matches, [&](int shift) {
    return MatchRawImages(sequence, detector, matcher, few, shift);
  });
  report.has_imu = rig.imu && !sequence.imu().empty();
  if (report.has_imu) {
    report.calibrated_time_offset = rig.imu_time_offset;
    report.calibrated_noise = *rig.imu;
    ImuNoise unknown;
    unknown.rate_hz = rig.imu->rate_hz;
    report.measured_noise = WithMeasuredNoise(unknown, sequence.imu());
    report.imu = CheckTurns(sequence, report.matches);
  }
  Judge(report);
  return report;
}

}  // namespace airslam
