// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <string>

namespace airslam {

// A picture file as 8-bit grey. 16-bit pictures are scaled by 1/256, colours are weighted. Throws
// Error that names the file when it is missing or not a picture.
cv::Mat ReadGreyPicture(const std::string& file);

// Writes a picture in the format that the file's ending names. Throws Error that names the file.
void WritePicture(const std::string& file, const cv::Mat& picture);

}  // namespace airslam
