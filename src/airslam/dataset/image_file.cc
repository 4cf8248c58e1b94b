// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/dataset/image_file.h"

#include <algorithm>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "airslam/common/error.h"
#include "airslam/dataset/picture_formats.h"

namespace airslam {
namespace {

std::vector<char> ReadBytes(const std::filesystem::path& file) {
  if (!std::filesystem::exists(file)) Fail("the image {} is missing", file.string());
  std::ifstream stream(file, std::ios::binary | std::ios::ate);
  std::vector<char> bytes(stream ? static_cast<std::size_t>(std::max<std::streamoff>(
                                       0, static_cast<std::streamoff>(stream.tellg())))
                                 : 0);
  stream.seekg(0);
  stream.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  if (!stream) Fail("the image {} cannot be read", file.string());
  if (bytes.empty()) Fail("the image {} is empty", file.string());
  return bytes;
}

// The decoders of JPEG and PNG may fill up a file that was cut off and say nothing; the mark that
// ends such a file tells.
bool IsCutOff(const std::vector<char>& bytes) {
  using namespace std::string_view_literals;
  const std::string_view all(bytes.data(), bytes.size());
  const std::string_view tail = all.substr(all.size() - std::min<std::size_t>(all.size(), 1024));
  if (all.starts_with("\xFF\xD8"sv)) return tail.find("\xFF\xD9"sv) == std::string_view::npos;
  if (all.starts_with("\x89PNG"sv)) return tail.find("IEND"sv) == std::string_view::npos;
  return false;
}

}  // namespace

cv::Mat DecodeGrey(const std::filesystem::path& file) {
  std::vector<char> bytes = ReadBytes(file);
  if (IsCutOff(bytes)) Fail("the image {} is cut off", file.string());
  if (std::optional<cv::Mat> grey = DecodeCommonFormat(bytes)) return std::move(*grey);
  const cv::Mat encoded(1, static_cast<int>(bytes.size()), CV_8UC1, bytes.data());
  cv::Mat grey;
  try {
    grey = DecodeWithOpenCv(
        encoded, cv::IMREAD_GRAYSCALE | cv::IMREAD_ANYDEPTH | cv::IMREAD_IGNORE_ORIENTATION);
  } catch (const cv::Exception&) {
    grey.release();
  }
  if (grey.empty()) Fail("the image {} cannot be decoded", file.string());
  if (grey.type() != CV_8UC1 && grey.type() != CV_16UC1) {
    Fail("the image {} has neither 8 nor 16 bits a channel", file.string());
  }
  return grey;
}

cv::Mat ToEightBit(const cv::Mat& grey, bool twelve_bit) {
  if (grey.type() == CV_8UC1) return grey;
  const int shift = twelve_bit ? 4 : 8;
  cv::Mat result(grey.size(), CV_8UC1);
  for (int v = 0; v < grey.rows; ++v) {
    const auto* from = grey.ptr<std::uint16_t>(v);
    auto* to = result.ptr<std::uint8_t>(v);
    for (int u = 0; u < grey.cols; ++u) {
      to[u] = static_cast<std::uint8_t>(std::min(from[u] >> shift, 255));
    }
  }
  return result;
}

void WritePicture(const std::filesystem::path& file, const cv::Mat& picture) {
  bool written = false;
  try {
    written = WriteWithOpenCv(file.string(), picture);
  } catch (const cv::Exception&) {  // an ending that names no picture format
  }
  if (!written) {
    Fail(
        "{}: the picture could not be written; the folder must exist and the name end in .png "
        "or .jpg",
        file.string());
  }
}

}  // namespace airslam
