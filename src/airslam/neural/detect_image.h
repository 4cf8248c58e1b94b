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
};

// Finds all that the network can find, without the limits that keep a robot's frames fast: what
// `airslam detect` and Python's Detector do. image and mask as in FeatureDetector::Detect. Throws
// Error when a number of the request is out of its range, and as the detector does.
Detections DetectImage(const cv::Mat& image, const cv::Mat& mask, const ImageRequest& request,
                       FeatureDetector& detector);

}  // namespace airslam
