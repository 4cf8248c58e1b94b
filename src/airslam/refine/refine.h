// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>

#include "airslam/refine/map_processor.h"

namespace airslam {

// What refining a map gave, besides the map.
struct RefineResult {
  nlohmann::json report;  // keys: docs/refine.md
  std::vector<Loop> loops;
  std::optional<PlaceRecord> place;
};

// Networks of the map's model pack; null where there is none.
struct RefineParts {
  FeatureMatcher* matcher = nullptr;
  std::shared_ptr<const Vocabulary> vocabulary = nullptr;
};

// Runs the map processors that the options name on the map, in their order, with a progress line
// each (with `quiet`: without). Deterministic but for the times and memory in the report. Throws
// Error.
RefineResult RefineMap(const RefineOptions& options, const RefineParts& parts, Map& map,
                       bool quiet = false);

// The consecutive keyframes of each component and the motions between them.
std::vector<OdometryEdge> CollectOdometry(const Map& map);

}  // namespace airslam
