// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/feature/image_pyramid.h"

#include <opencv2/imgproc.hpp>

namespace airslam {

ImagePyramid MakePyramid(const cv::Mat& image) {
  ImagePyramid pyramid;
  pyramid.levels[0] = image;
  for (int level = 1; level < ImagePyramid::kLevels; ++level) {
    cv::pyrDown(pyramid.levels[level - 1], pyramid.levels[level]);
  }
  return pyramid;
}

}  // namespace airslam
