// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/neural/detect_image.h"

#include <algorithm>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "airslam/common/error.h"

namespace airslam {
namespace {

void Validate(const ImageRequest& request) {
  if (request.max_keypoints < 0) {
    Fail("max_keypoints = {} must be at least 0", request.max_keypoints);
  }
  if (!(request.min_line_score >= 0 && request.min_line_score <= 1)) {
    Fail("min_line_score = {} must be between 0 and 1", request.min_line_score);
  }
  if (!(request.line_scale >= 1 && request.line_scale <= 4)) {
    Fail("line_scale = {} must be between 1 and 4", request.line_scale);
  }
}

// The size of an image enlarged for its lines.
cv::Size SizeForLines(cv::Size image, float line_scale) {
  const float side = static_cast<float>(std::min(image.width, image.height));
  const float scale = std::clamp(static_cast<float>(kEnlargedSide) / side, 1.0F, line_scale);
  return {cvRound(static_cast<float>(image.width) * scale),
          cvRound(static_cast<float>(image.height) * scale)};
}

// Moves what was found in an image of size `from` to where it is in one of size `to`.
void Move(cv::Size from, cv::Size to, Detections& found) {
  const auto move = [](float& place, int from_size, int to_size) {
    const float factor = static_cast<float>(to_size) / static_cast<float>(from_size);
    place = std::clamp((place + 0.5F) * factor - 0.5F, 0.0F, static_cast<float>(to_size - 1));
  };
  for (Keypoint& junction : found.junctions) {
    move(junction.x, from.width, to.width);
    move(junction.y, from.height, to.height);
  }
  for (LineSegment& line : found.lines) {
    for (float* x : {&line.x1, &line.x2}) move(*x, from.width, to.width);
    for (float* y : {&line.y1, &line.y2}) move(*y, from.height, to.height);
  }
}

}  // namespace

Detections DetectImage(const cv::Mat& image, const cv::Mat& mask, const ImageRequest& request,
                       FeatureDetector& detector) {
  Validate(request);
  DetectionRequest asked(request.max_keypoints, request.lines, request.min_line_score);
  asked.max_junctions = asked.max_line_proposals = std::numeric_limits<int>::max();
  const bool lines = request.lines && detector.finds_lines() && !image.empty();
  const cv::Size size = lines ? SizeForLines(image.size(), request.line_scale) : image.size();
  if (size == image.size()) return detector.Detect(image, mask, asked);

  Detections found = detector.Detect(image, mask, {request.max_keypoints});
  cv::Mat enlarged, enlarged_mask;
  cv::resize(image, enlarged, size, 0, 0, cv::INTER_LINEAR);
  if (!mask.empty()) cv::resize(mask, enlarged_mask, size, 0, 0, cv::INTER_NEAREST);
  Detections seen = detector.FindLines(enlarged, enlarged_mask, {}, asked);
  Move(size, image.size(), seen);
  found.lines = std::move(seen.lines);
  found.line_ends = std::move(seen.line_ends);
  found.junctions = std::move(seen.junctions);
  found.junction_descriptors = std::move(seen.junction_descriptors);
  return found;
}

}  // namespace airslam
