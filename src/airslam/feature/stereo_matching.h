// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>
#include <vector>

#include "airslam/feature/image_pyramid.h"
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
  // With fewer matches at full resolution than this, those at half resolution, where noise is
  // weaker, count as well.
  int coarse_below = 80;
  PatchAlignmentOptions alignment;
};

// The left and the right rectified image of one keyframe with their features.
struct StereoView {
  const ImagePyramid& left_image;
  const ImagePyramid& right_image;  // of the same size
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
