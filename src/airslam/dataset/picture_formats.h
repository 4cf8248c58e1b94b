// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <optional>
#include <span>
#include <string>

namespace airslam {

// The pixels of a JPEG in grey or in colours, or of a grey PNG of 8 or 16 bits: what cameras and
// data sets store. Nothing of any other file, or of one that these decoders refuse: OpenCV may know
// it. Thread-safe.
std::optional<cv::Mat> DecodeCommonFormat(std::span<const char> bytes);

// cv::imdecode, cv::imread and cv::imwrite of OpenCV's library of picture formats, which is loaded
// when it is needed first: it brings 115 more (of maps, films and X-ray pictures), which take 75 ms
// and 39 MB, more than all the rest of the program. Thread-safe. Throw Error where the library
// cannot be loaded, and cv::Exception as OpenCV does.
cv::Mat DecodeWithOpenCv(const cv::Mat& bytes, int flags);
cv::Mat ReadWithOpenCv(const std::string& file, int flags);
bool WriteWithOpenCv(const std::string& file, const cv::Mat& picture);

}  // namespace airslam
