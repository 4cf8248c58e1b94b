// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <nlohmann/json.hpp>

#include "airslam/evaluate/trajectory_error.h"

namespace airslam {

// What `airslam eval --json` and airslam.evaluate say of a comparison: metres, degrees, seconds and
// counts, under keys that name their units (docs/outputs.md).
nlohmann::json ToJson(const TrajectoryErrors& errors);

}  // namespace airslam
