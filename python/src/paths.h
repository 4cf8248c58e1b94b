// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

namespace airslam::python {

// The map file that a user means: the file, or map.db of the folder that a run wrote.
inline std::filesystem::path MapFileOf(const std::filesystem::path& path) {
  return std::filesystem::exists(path / "map.db") ? path / "map.db" : path;
}

}  // namespace airslam::python
