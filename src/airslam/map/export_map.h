// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>

namespace airslam {

// What to write of a map for other programs; what is empty is not written.
struct ExportRequest {
  std::filesystem::path map;          // map file, or folder of a run
  std::filesystem::path tum;          // poses of the keyframes' bodies (WriteTum)
  std::filesystem::path ply;          // points, lines and path (WritePly)
  std::filesystem::path colmap;       // folder of a COLMAP model (WriteColmap)
  std::optional<int> component = {};  // nothing: the largest, with a warning about the others
};

// Writes one component of a map in formats of other programs: what `airslam export` and Python's
// export do. Returns the component. Throws Error when nothing is asked for, the map cannot be
// read, has no such component, or a file cannot be written.
int ExportMap(const ExportRequest& request);

}  // namespace airslam
