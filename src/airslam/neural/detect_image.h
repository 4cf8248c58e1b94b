// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>

#include "airslam/neural/feature_detector.h"

namespace airslam {

// What to look for in an image that is looked at by itself, with time for all lines.
struct ImageRequest {
  int max_keypoints = 400;
  bool lines = true;
  float min_line_score = 0;  // 0: all proposals
  // 1..4: lines are looked for in the image enlarged by so much, up to kEnlargedSide; at 1 in the
  // pass that finds the keypoints, as mapping does. The network sees a line of 60 pixels better
  // than one of 30: sAP10 of held-out photos (288 rows) at 1, 1.25, 1.5, 1.75,
  // 2: 39.6, 46.1, 50.4, 50.8, 52.7, of rooms: 32.7, 38.8, 44.7, 45.1, 47.3.
  float line_scale = 2.0F;
};

// Pixels of the shorter side beyond which an image is not enlarged.
inline constexpr int kEnlargedSide = 720;

// Finds all that the network can find, without the limits that keep a robot's frames fast: what
// `airslam detect` and Python's Detector do. image and mask as in FeatureDetector::Detect. Throws
// Error when a number of the request is out of its range, and as the detector does. All places are
// in pixels of the image.
Detections DetectImage(const cv::Mat& image, const cv::Mat& mask, const ImageRequest& request,
                       FeatureDetector& detector);

}  // namespace airslam
