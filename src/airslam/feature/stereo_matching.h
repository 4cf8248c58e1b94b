// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <span>
#include <vector>

#include "airslam/feature/patch_alignment.h"
#include "airslam/geometry/pinhole.h"
#include "airslam/neural/detections.h"

namespace airslam {

struct StereoMatchingOptions {
  double max_row_difference = 2.5;   // pixels, between detected keypoints
  double max_aligned_row_difference = 1.0;  // pixels, after alignment
  double min_depth = 0.3;            // metres: bounds the disparity
  double min_disparity = 0.3;        // pixels: below it the depth is unknown
  double min_similarity = 0.6;       // cosine of the descriptors
  PatchAlignmentOptions alignment;
};

// The left and the right rectified image of one keyframe with their features.
struct StereoView {
  const cv::Mat& left_image;   // CV_8UC1
  const cv::Mat& right_image;  // CV_8UC1, same size
  std::span<const Keypoint> left_keypoints;
  const DescriptorMatrix& left_descriptors;
  const Detections& right;
};

// Finds the column of each left keypoint in the right image, to sub-pixel accuracy; -1 where there
// is none. A keypoint with an expected disparity (>= 0, in pixels; from a landmark) is sought there
// by its patch; the others by descriptor along the epipolar row, mutually best, then by patch.
std::vector<float> MatchStereo(const StereoView& view, const StereoCamera& stereo,
                               std::span<const float> expected_disparities,
                               const StereoMatchingOptions& options);

}  // namespace airslam
