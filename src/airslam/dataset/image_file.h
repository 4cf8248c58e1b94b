// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <opencv2/core.hpp>

namespace airslam {

// Decodes an image file to grey: CV_8UC1, or CV_16UC1 if the file has 16 bits a channel. Colours
// are weighed as usual (0.299 R + 0.587 G + 0.114 B). Thread-safe. Throws Error when the file is
// missing, cut off or no image.
cv::Mat DecodeGrey(const std::filesystem::path& file);

// 16-bit to 8-bit grey: the upper 8 of the 16 bits, or of the lower 12 bits if `twelve_bit`
// (cameras that store 12 bits unshifted). 8-bit images pass through.
cv::Mat ToEightBit(const cv::Mat& grey, bool twelve_bit);

// Writes a picture in the format that the file's ending names. Throws Error that names the file.
void WritePicture(const std::filesystem::path& file, const cv::Mat& picture);

}  // namespace airslam
