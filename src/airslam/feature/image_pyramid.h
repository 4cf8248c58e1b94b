// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <opencv2/core.hpp>

namespace airslam {

// An image at full, half and quarter size. Pixel x of the image lies at x / 2^level of a level.
struct ImagePyramid {
  static constexpr int kLevels = 3;
  std::array<cv::Mat, kLevels> levels;  // CV_8UC1

  const cv::Mat& full() const { return levels[0]; }
};

// `image` is shared, not copied.
ImagePyramid MakePyramid(const cv::Mat& image);

}  // namespace airslam
