// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "airslam/calibrate/rig_fit.h"

namespace airslam {

// What can be wrong with the calibration of two cameras.
enum class RigFault {
  kNone,
  kTooFewMatches,   // nothing can be said
  kResolution,      // intrinsics of images of another size
  kSwapped,         // left is right
  kInverted,        // an extrinsic is the inverse of what it should be
  kDistortion,      // model or coefficients
  kUnsynchronised,  // the right image is taken at another time
  kTurned,          // the cameras stand otherwise than calibrated
  kUnexplained,     // the matches contradict the calibration, and none of the above explains it
};
// A word for programs: "none", "resolution", ...
std::string ToString(RigFault fault);

// The calibration as it would be right if one known mistake had been made.
struct RigHypothesis {
  RigFault fault = RigFault::kNone;
  std::string mistake;  // as part of a sentence
  StereoRig rig;
};
// Cameras or their extrinsics exchanged; either, both or the relation of the two inverted; the
// coefficients belonging to another distortion model; intrinsics of images 4 times smaller to 4
// times larger.
std::vector<RigHypothesis> RigHypotheses(const StereoRig& rig);

// By how much intrinsics must be multiplied if the principal point is to lie in the middle of the
// image, when that is the same for both axes of both cameras and more than a quarter off 1: no lens
// is mounted like that, but intrinsics of an image of another size look so.
std::optional<double> ScaleOfPrincipalPoints(const StereoRig& rig);

// Epipolar errors of the matches within a ring around the left principal point.
struct RadiusRing {
  double max_radius = 0;  // pixels
  double median = 0;      // pixels
  int matches = 0;
};

struct RigDiagnosis {
  RigFault fault = RigFault::kNone;
  std::string sentence;

  RigFit calibrated;      // errors under the calibration as it is
  RigFit turned;          // with the right camera's pose free: the rotation error of the rig
  RigFit delayed;         // with the right image's delay free, of the matches with a velocity
  double noise = 0;       // pixels, standard deviation of one match; how it is found: see below
  double systematic = 0;  // pixels: what of the errors a better calibration would remove
  double allowed = 0;     // pixels: more systematic error than this is wrong
  double behind = 0;      // share of the matches that meet behind the cameras
  std::vector<RadiusRing> rings;
};

// The right images of frames taken `shift` frames later, matched with the left ones.
using ShiftedMatches = std::function<RawMatches(int shift)>;

// Says what is wrong, if anything. Everything is measured against the noise of these matches: the
// least robust scale (1.4826 * median) of the epipolar errors under the calibration, under each
// hypothesis, and with all parts of RigCorrection free.
//
// The calibration is right when nine of ten matches stay within the difference of rows that stereo
// matching allows (StereoMatchingOptions::max_row_difference, 1 px): its systematic error
// (SystematicError against all parts free, a 90th percentile) and the noise's 90th
// percentile, 1.645 sigma, squared and added, must stay below that squared. A systematic error
// below one noise is always allowed. And most matches must meet in front of the cameras.
//
// Else every hypothesis, a shift by one or two frames and every single part of a correction is
// tried, and the one with the least cost (RigFit::Cost) is named; a part of a correction must beat
// the others, which have nothing to adjust, by a third.
RigDiagnosis DiagnoseRig(const StereoRig& rig, const RawMatches& matches,
                         const ShiftedMatches& shifted);

}  // namespace airslam
