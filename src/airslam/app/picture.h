// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace airslam {

// A picture file as 8-bit grey. 16-bit pictures are scaled by 1/256, colours are weighted. Throws
// Error that names the file when it is missing or not a picture.
cv::Mat ReadGreyPicture(const std::string& file);

// The pictures that `input` names: itself, or those of the folder, by name (by the endings that
// pictures have). Throws Error for a folder without any.
std::vector<std::filesystem::path> ListPictures(const std::string& input);

}  // namespace airslam
