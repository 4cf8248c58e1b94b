// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>

#include <vector>

#include "airslam/neural/detections.h"

namespace airslam {

// Which local maxima of a score map become keypoints.
struct KeypointDecoderOptions {
  int max_keypoints = 350;     // >= 0
  float score_threshold = -5;  // a keypoint's logit is larger
  int nms_radius = 2;          // pixels, 1..16: a keypoint has the largest logit of its square
  int border = 4;  // pixels, >= 1: no keypoint so near to the image's edge or to a masked pixel
  // Share (0..1) of max_keypoints that is dealt out evenly over the image. The image is cut into
  // square cells of about `cell_size` pixels; going down the scores, each cell may first take its
  // quota ceil(spread * max_keypoints / number of cells); what then is still free goes to the best
  // that are left, wherever they lie. 0 is plain best-first. A pose needs points from all over the
  // image, and the strongest corners of one shelf tend to be all on that shelf; but weak points
  // repeat less. Measured on day/dynamic pairs of the warehouse (EdgePoint2-E64, 350 keypoints,
  // nearest neighbours), correct matches and 64-pixel cells that have one: spread 0: 250 in 50.7,
  // 0.3: 242 in 58.8, 0.5: 235 in 62.5.
  float spread = 0.3F;
  int cell_size = 96;  // pixels, >= 8
  // Whether positions are refined by the extremum of a quadratic through the 3x3 logits, at most
  // half a pixel along each axis.
  bool subpixel = true;

  // Throws Error that names the wrong field.
  void Validate() const;
};

// A dense map of logits, row-major.
struct ScoreMap {
  const float* data = nullptr;
  int width = 0;   // of the image part that may hold keypoints
  int height = 0;  // likewise
  int stride = 0;  // values from one row to the next, >= width
};

// Finds keypoints: logit above the threshold, the largest of the (2r+1)^2 square around it (of
// equal ones the first in row-major order), away from the image's edge and from masked pixels.
// mask: empty, or CV_8UC1 of height x width, zero where no keypoint may be. Returns at most
// max_keypoints, best first, ties by row, then column of their pixel. NaN is no keypoint.
std::vector<Keypoint> DecodeKeypoints(const ScoreMap& scores, const cv::Mat& mask,
                                      const KeypointDecoderOptions& options);

}  // namespace airslam
