// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "airslam/map/map.h"

namespace airslam {

// Adds the keyframes and landmarks of `second` to `first`, with ids and components that follow
// those of `first`. The second session's components stay components of their own: refining finds
// its places in the first map and joins them. Throws Error when the maps were made with different
// cameras or model packs; `first_name` and `second_name` stand in its sentence.
void AppendMap(const Map& second, Map& first, const std::string& first_name,
               const std::string& second_name);

}  // namespace airslam
