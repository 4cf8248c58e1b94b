// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/neural/detect_image.h"

#include <limits>

#include "airslam/common/error.h"

namespace airslam {

Detections DetectImage(const cv::Mat& image, const cv::Mat& mask, const ImageRequest& request,
                       FeatureDetector& detector) {
  if (request.max_keypoints < 0) {
    Fail("max_keypoints = {} must be at least 0", request.max_keypoints);
  }
  if (!(request.min_line_score >= 0 && request.min_line_score <= 1)) {
    Fail("min_line_score = {} must be between 0 and 1", request.min_line_score);
  }
  DetectionRequest asked(request.max_keypoints, request.lines, request.min_line_score);
  asked.max_junctions = asked.max_line_proposals = std::numeric_limits<int>::max();
  return detector.Detect(image, mask, asked);
}

}  // namespace airslam
