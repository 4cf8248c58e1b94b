// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>

#include "airslam/neural/detections.h"

namespace airslam {

// What to look for in an image. A number of keypoints alone is a request without lines.
struct DetectionRequest {
  DetectionRequest(int keypoints, bool with_lines = false, float least_score = 0.3F)
      : max_keypoints(keypoints), lines(with_lines), min_line_score(least_score) {}

  int max_keypoints;  // >= 0
  bool lines;         // lines and junctions as well; costs about half as much again
  // 0..1: the least score of a line. 0 keeps all proposals; the model pack's README tells the
  // precision at each score.
  float min_line_score;
  // >= 2 and >= 1: lines are looked for among so many of the surest junctions, and so many of the
  // most promising pairs of these are judged; never more than the pack allows. Time grows with the
  // square of the first. Of the lines over 0.4 among 1280 proposals, 2 to 4 % come after the 896th.
  int max_junctions = 256;
  int max_line_proposals = 1280;
  bool keep_maps = false;  // in Detections::maps: some megabytes
};

// Finds keypoints and lines with descriptors. Implementations: PLNet, and stand-ins in tests, which
// know no lines. One instance is used by one thread at a time; the result depends on the arguments
// only.
class FeatureDetector {
 public:
  virtual ~FeatureDetector() = default;

  // image: CV_8UC1. mask: CV_8UC1 of the same size, features only where it is not zero, or empty.
  // Returns at most `max_keypoints` keypoints, best first, at integer or sub-pixel positions.
  virtual Detections Detect(const cv::Mat& image, const cv::Mat& mask,
                            const DetectionRequest& request) = 0;

  // The lines and junctions of an image that was `seen` before, with keep_maps, by this or another
  // detector of the same networks: those that Detect(image, mask, request) finds, without what was
  // computed then. Keypoints are not looked for.
  virtual Detections FindLines(const cv::Mat& image, const cv::Mat& mask,
                               const Detections& /*seen*/, DetectionRequest request) {
    request.max_keypoints = 0;
    return Detect(image, mask, request);
  }

  // Whether lines can be asked for; a detector without them returns none.
  virtual bool finds_lines() const { return false; }

  // D, the length of a descriptor.
  virtual int descriptor_size() const = 0;
};

}  // namespace airslam
