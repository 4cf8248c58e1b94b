// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <opencv2/core.hpp>
#include <span>
#include <vector>

namespace airslam {

// The maps that a feature network has computed of one image. Who keeps them can look for lines in
// the image later, without a second pass over it.
struct ImageMaps {
  cv::Size image_size;
  std::vector<cv::Mat> values;  // of each map of the pack: one row of CV_32FC1
};

// Memory for maps, used again once nobody holds them: that of one image is some megabytes, and a
// page that is touched for the first time costs more than what is written to it. May be used, and
// outlived by its maps, on several threads.
class ImageMapPool {
 public:
  ImageMapPool();

  // Maps of so many values each, whatever they hold.
  std::shared_ptr<ImageMaps> Take(cv::Size image_size, std::span<const int> sizes);

 private:
  struct Shelf;
  std::shared_ptr<Shelf> shelf_;
};

}  // namespace airslam
