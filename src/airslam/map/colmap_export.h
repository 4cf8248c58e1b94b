// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "airslam/map/map.h"

namespace airslam {

// Writes the component as a COLMAP model in text form: cameras.txt, images.txt and points3D.txt in
// `folder`, which is created; files of these names in it are replaced. Identifiers are keyframe and
// landmark ids plus 1 (COLMAP's begin at 1). There is one PINHOLE camera, the rectified left one;
// an image is called "<timestamp in ns>.png". COLMAP puts (0.5, 0.5) at the centre of the first
// pixel, where this program has (0, 0): pixels and principal point are shifted by a half. Poses are
// cam_from_world, points are grey and carry their mean re-projection error. Throws Error when the
// folder cannot be written.
void WriteColmap(const Map& map, int component, const std::filesystem::path& folder);

}  // namespace airslam
