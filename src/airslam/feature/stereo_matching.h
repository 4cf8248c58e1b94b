// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>
#include <vector>

#include "airslam/feature/image_pyramid.h"
#include "airslam/feature/patch_alignment.h"
#include "airslam/feature/row_search.h"
#include "airslam/geometry/pinhole.h"
#include "airslam/neural/detections.h"

namespace airslam {

struct StereoMatchingOptions {
  double max_row_difference = 1.0;  // pixels, after alignment
  double min_depth = 0.3;           // metres: bounds the disparity
  double min_disparity = 0.3;       // pixels: below it the depth is unknown
  // With fewer matches at full resolution than this, those at half resolution, where noise is
  // weaker, count as well.
  int coarse_below = 80;
  RowSearchOptions search;
  // Both images are of one moment: patches agree better than those of two frames do. Where noise
  // is strong they cannot.
  PatchAlignmentOptions alignment = {.min_correlation = 0.9};
  PatchAlignmentOptions coarse_alignment = {.min_correlation = 0.75};
};

// The left and the right rectified image of one keyframe with their features.
struct StereoView {
  const ImagePyramid& left_image;
  const ImagePyramid& right_image;  // of the same size
  std::span<const Keypoint> left_keypoints;
};

// Finds the column of each left keypoint in the right image, to sub-pixel accuracy; -1 where there
// is none. A keypoint with an expected disparity (>= 0, in pixels; from a landmark) is sought there
// by its patch; the others along the whole epipolar row.
std::vector<float> MatchStereo(const StereoView& view, const StereoCamera& stereo,
                               std::span<const float> expected_disparities,
                               const StereoMatchingOptions& options);

}  // namespace airslam
