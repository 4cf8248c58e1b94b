// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include <opencv2/core.hpp>

namespace airslam {

struct PatchAlignmentOptions {
  int max_iterations = 12;
  double convergence = 0.01;      // pixels: stop when a step is shorter
  double max_displacement = 4.0;  // pixels from the initial guess
  double min_correlation = 0.75;  // zero-mean normalised, in [-1, 1]
};

struct PatchAlignment {
  bool converged = false;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();  // in the current image
  double correlation = 0;                           // zero-mean normalised, in [-1, 1]
};

// Finds, to sub-pixel accuracy, where an 11x11 patch of the reference image lies in the current
// image: inverse-compositional Lucas-Kanade over a translation (Baker and Matthews, "Lucas-Kanade
// 20 Years On", IJCV 2004) on patches normalised to zero mean and unit variance, so that gain and
// offset of the light do not matter.
//
// Images are CV_8UC1. `current_from_reference` is the local 2x2 change of shape between the images
// (identity when unknown); `guess` is where the search starts in the current image. Not converged
// when a patch leaves an image, has no texture, moves too far or correlates too little.
PatchAlignment AlignPatch(const cv::Mat& reference, const Eigen::Vector2d& reference_pixel,
                          const Eigen::Matrix2d& current_from_reference, const cv::Mat& current,
                          const Eigen::Vector2d& guess, const PatchAlignmentOptions& options);

}  // namespace airslam
