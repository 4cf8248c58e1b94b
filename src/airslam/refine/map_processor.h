// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "airslam/map/map.h"
#include "airslam/map/place_record.h"
#include "airslam/neural/feature_matcher.h"
#include "airslam/optimize/relative_pose_factor.h"
#include "airslam/place/vocabulary.h"
#include "airslam/refine/options.h"

namespace airslam {

// A place that was seen twice: keyframe `later` shows what `earlier` shows.
struct Loop {
  KeyframeId earlier = -1, later = -1;
  int matches = 0;
  int inliers = 0;
  Rigid3 earlier_from_later;                   // cameras
  Matrix6d covariance = Matrix6d::Identity();  // rotation (rad), position (m): RelativePose
  // Its points were made one: they say in a bundle what the relative pose says, and say it better.
  bool merged = false;
  std::vector<std::pair<int, int>> keypoints;  // the inliers: of `earlier`, of `later`
};

// The motion between two consecutive keyframes as odometry found it.
struct OdometryEdge {
  KeyframeId from = -1, to = -1;
  Rigid3 from_from_to;  // cameras
};

// What the map processors of one run work with and hand on to each other, besides the map.
struct RefineContext {
  const RefineOptions& options;
  // Networks of the map's model pack. Null where there is none.
  FeatureMatcher* matcher = nullptr;
  std::shared_ptr<const Vocabulary> vocabulary = nullptr;

  std::vector<OdometryEdge> odometry = {};  // of the map as it was before the first processor
  std::vector<Loop> loops = {};             // found so far
  std::optional<PlaceRecord> place = {};    // to be stored with the map
  // What the present processor has to say, for the report.
  nlohmann::json report = nlohmann::json::object();
  // Call it now and then: so many of so many steps are done; a word or two.
  std::function<void(int done, int total, std::string_view state)> progress =
      [](int, int, std::string_view) {};
};

// One step of the refinement of a map. It changes the map and the context in place, and is
// deterministic. What holds before must hold after: keyframes name landmarks of the map or
// kNoLandmark, every landmark's `first_seen_by` is a keyframe of the map, the first keyframe of a
// component stays where it is. Throws Error with one sentence when it cannot work.
class MapProcessor {
 public:
  virtual ~MapProcessor() = default;
  virtual void Process(Map& map, RefineContext& context) = 0;
};

// Processors by name: loop_closure, merge, pose_graph, global_bundle, junction_vocabulary, and what
// users add (docs/refine.md). A name that is taken is replaced. Not thread-safe: register before
// refining.
using MapProcessorFactory = std::function<std::unique_ptr<MapProcessor>()>;
void RegisterMapProcessor(const std::string& name, MapProcessorFactory factory);

// Throws Error that lists the names when `name` is none of them.
std::unique_ptr<MapProcessor> MakeMapProcessor(const std::string& name);

}  // namespace airslam
