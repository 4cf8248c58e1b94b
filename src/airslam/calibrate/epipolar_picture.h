// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>

#include "airslam/calibrate/raw_matches.h"
#include "airslam/sensor/rig.h"

namespace airslam {

// Left and right raw image of a frame side by side (CV_8UC3). A few matches, spread over the image,
// each in a colour: a ring at the point in the left image and at its match in the right one, and
// where the calibration says that the match may lie: the curve of the point at all distances from
// 0.3 m on. With a right calibration the curves go through the rings.
cv::Mat DrawEpipolarCurves(const StereoRig& rig, const StereoPair& pair, const RawMatches& matches,
                           int frame, int curves = 24);

}  // namespace airslam
