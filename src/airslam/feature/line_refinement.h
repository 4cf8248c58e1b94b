// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <optional>

#include "airslam/neural/detections.h"

namespace airslam {

struct LineRefinementOptions {
  double reach = 3.0;         // pixels: how far an end may move across the line
  double usual_error = 1.5;   // pixels: that of an end; of two edges the nearer is the likelier
  double max_tilt = 2.0;      // pixels: how much farther one end may move than the other
  double min_gradient = 2.0;  // grey levels a pixel: less is no edge
  double max_residual = 0.5;  // pixels that a place on the edge may lie off the straight line
  double min_share = 0.5;     // of the places along the line that must show the edge
};

// The straight edge along a line of a CV_8UC1 image: its ends moved across the line to where the
// grey levels change most. A network says where a line is to a fraction of its cells, the image
// itself to a tenth of a pixel. Nothing where no straight edge is to be seen, and for lines shorter
// than 10 pixels.
std::optional<LineSegment> RefineLine(const LineSegment& line, const cv::Mat& image,
                                      const LineRefinementOptions& options = {});

}  // namespace airslam
