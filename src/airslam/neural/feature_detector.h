// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>

#include "airslam/neural/detections.h"

namespace airslam {

// Finds keypoints (and, later, lines) with descriptors. Implementations: PLNet, and stand-ins in
// tests. One instance is used by one thread at a time; the result depends on the arguments only.
class FeatureDetector {
 public:
  virtual ~FeatureDetector() = default;

  // image: CV_8UC1. mask: CV_8UC1 of the same size, features only where it is not zero, or empty.
  // Returns at most `max_keypoints` keypoints, best first, at integer or sub-pixel positions.
  virtual Detections Detect(const cv::Mat& image, const cv::Mat& mask, int max_keypoints) = 0;

  // D, the length of a descriptor.
  virtual int descriptor_size() const = 0;
};

}  // namespace airslam
