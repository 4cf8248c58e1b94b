// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>

#include "airslam/map/map.h"
#include "airslam/map/place_record.h"

namespace airslam {

// Writes a whole map and, if there is one, its place record. The file appears as a whole: until
// then, and when it cannot be written (an Error), an earlier one stays as it was.
void WriteMap(const Map& map, const std::optional<PlaceRecord>& place,
              const std::filesystem::path& file);

}  // namespace airslam
