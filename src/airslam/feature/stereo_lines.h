// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>
#include <vector>

#include "airslam/feature/image_pyramid.h"
#include "airslam/feature/row_search.h"
#include "airslam/geometry/pinhole.h"
#include "airslam/neural/detections.h"

namespace airslam {

struct StereoLineOptions {
  double spacing = 10.0;           // pixels between the samples along a line
  double min_slope = 0.2;          // rows a pixel of length: a level line slides along itself
  double min_depth = 0.3;          // metres: bounds the disparity
  double max_residual = 1.5;       // pixels, at half resolution's precision
  double max_fine_residual = 1.0;  // pixels, at full resolution
  double min_share = 0.6;          // of a line's samples that must agree
  RowSearchOptions search;
};

// Finds the lines of the left rectified image in the right one: one a line, kNoLine where it is not
// found. A line's disparity changes evenly along its image (1/Z of a line in space does), so what
// its samples find along their rows must lie on one straight line; the ends are on the rows of the
// left line's ends, and may lie outside the image. The images are of the same size.
std::vector<LineSegment> FindRightLines(std::span<const LineSegment> left,
                                        const ImagePyramid& left_image,
                                        const ImagePyramid& right_image, const StereoCamera& stereo,
                                        const StereoLineOptions& options = {});

}  // namespace airslam
