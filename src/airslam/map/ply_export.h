// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "airslam/map/map.h"

namespace airslam {

// Writes the component's landmarks as a PLY file (text; MeshLab, CloudCompare and Open3D open it):
// `vertex` holds x, y, z in metres in the map's world and red, green, blue; points are grey, a
// line's ends orange and joined by an `edge`; the keyframes' cameras follow as blue vertices,
// joined in order of time. Replaces the file in one step. Throws Error when it cannot be written.
void WritePly(const Map& map, int component, const std::filesystem::path& file);

}  // namespace airslam
