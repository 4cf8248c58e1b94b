// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <optional>

namespace airslam {

struct RowSearchOptions {
  double min_correlation = 0.6;  // zero-mean normalised, in [-1, 1]
  // The best place's 1 - correlation must be less than this share of any other maximum's: where a
  // second one looks nearly as good, the best one is a guess.
  double max_ambiguity = 0.8;
};

// Seeks the 11x11 patch around (`column`, `row`) of `reference` in the same row of `image`, from
// column `first` to column `last`. Returns the column, between two by the parabola through the best
// three; nothing where the patch has no texture, leaves an image, correlates too little, best at
// the end of the range or nearly as well at a second place. Images are CV_8UC1 and of the same
// size.
std::optional<double> SearchRow(const cv::Mat& reference, const cv::Mat& image, int column, int row,
                                int first, int last, const RowSearchOptions& options);

}  // namespace airslam
