// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/app/picture.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <opencv2/imgcodecs.hpp>
#include <system_error>

#include "airslam/common/error.h"
#include "airslam/dataset/picture_formats.h"

namespace airslam {
namespace {

namespace fs = std::filesystem;

bool IsPictureName(const fs::path& file) {
  static constexpr std::array kEndings = {".bmp", ".jpeg", ".jpg",  ".pgm", ".png",
                                          ".ppm", ".tif",  ".tiff", ".webp"};
  std::string ending = file.extension().string();
  std::transform(ending.begin(), ending.end(), ending.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return std::find(kEndings.begin(), kEndings.end(), ending) != kEndings.end();
}

}  // namespace

cv::Mat ReadGreyPicture(const std::string& file) {
  if (!fs::is_regular_file(file)) Fail("{}: no such picture", file);
  // OpenCV turns a photo as its orientation says.
  cv::Mat image = ReadWithOpenCv(file, cv::IMREAD_GRAYSCALE | cv::IMREAD_ANYDEPTH);
  if (image.empty()) Fail("{}: not a picture that can be read", file);
  if (image.depth() == CV_16U) image.convertTo(image, CV_8U, 1.0 / 256.0);
  if (image.type() != CV_8UC1) {
    Fail("{}: pixels of type {}, expected 8 or 16 bits a channel", file,
         cv::typeToString(image.type()));
  }
  return image;
}

std::vector<fs::path> ListPictures(const std::string& input) {
  std::error_code error;
  if (!fs::is_directory(input, error)) return {input};
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(input)) {
    if (entry.is_regular_file() && IsPictureName(entry.path())) files.push_back(entry.path());
  }
  if (files.empty()) Fail("{}: no picture in this folder", input);
  std::sort(files.begin(), files.end());
  return files;
}

}  // namespace airslam
