// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/app/picture.h"

#include <filesystem>
#include <opencv2/imgcodecs.hpp>

#include "airslam/common/error.h"

namespace airslam {

cv::Mat ReadGreyPicture(const std::string& file) {
  if (!std::filesystem::is_regular_file(file)) Fail("{}: no such picture", file);
  cv::Mat image = cv::imread(file, cv::IMREAD_GRAYSCALE | cv::IMREAD_ANYDEPTH);
  if (image.empty()) Fail("{}: not a picture that can be read", file);
  if (image.depth() == CV_16U) image.convertTo(image, CV_8U, 1.0 / 256.0);
  if (image.type() != CV_8UC1) {
    Fail("{}: pixels of type {}, expected 8 or 16 bits a channel", file,
         cv::typeToString(image.type()));
  }
  return image;
}

void WritePicture(const std::string& file, const cv::Mat& picture) {
  bool written = false;
  try {
    written = cv::imwrite(file, picture);
  } catch (const cv::Exception&) {  // an ending that names no picture format
  }
  if (!written) {
    Fail(
        "{}: the picture could not be written; the folder must exist and the name end in .png "
        "or .jpg",
        file);
  }
}

}  // namespace airslam
