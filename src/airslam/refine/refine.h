// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string_view>
#include <vector>

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

// How far a map processor is: `done` of `total` steps, in a word or two. The last word of each
// processor has `ended`, and repeats what it said before.
struct RefineProgress {
  std::string_view processor;
  int done = 0, total = 0;
  std::string_view state = {};
  bool ended = false;
};

// Called now and then, from the thread that refines. What it throws ends the refinement.
using RefineObserver = std::function<void(const RefineProgress&)>;

// Runs the map processors that the options name on the map, in their order. Deterministic but for
// the times and memory in the report. `observer` may be empty. Throws Error.
RefineResult RefineMap(const RefineOptions& options, const RefineParts& parts, Map& map,
                       const RefineObserver& observer = {});

// The consecutive keyframes of each component and the motions between them.
std::vector<OdometryEdge> CollectOdometry(const Map& map);

}  // namespace airslam
