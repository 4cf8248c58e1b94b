// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/refine/map_processor.h"

#include "airslam/common/error.h"
#include "airslam/refine/global_bundle.h"
#include "airslam/refine/junction_vocabulary.h"
#include "airslam/refine/loop_closure.h"
#include "airslam/refine/merge_landmarks.h"
#include "airslam/refine/pose_graph_processor.h"

namespace airslam {
namespace {

using Registry = std::map<std::string, MapProcessorFactory>;

Registry& TheRegistry() {
  static Registry registry = {
      {"loop_closure", [] { return std::make_unique<LoopClosure>(); }},
      {"merge", [] { return std::make_unique<MergeLandmarks>(); }},
      {"pose_graph", [] { return std::make_unique<PoseGraphProcessor>(); }},
      {"global_bundle", [] { return std::make_unique<GlobalBundle>(); }},
      {"junction_vocabulary", [] { return std::make_unique<JunctionVocabulary>(); }},
  };
  return registry;
}

}  // namespace

void RegisterMapProcessor(const std::string& name, MapProcessorFactory factory) {
  TheRegistry()[name] = std::move(factory);
}

std::unique_ptr<MapProcessor> MakeMapProcessor(const std::string& name) {
  const auto entry = TheRegistry().find(name);
  if (entry != TheRegistry().end()) return entry->second();
  std::string names;
  for (const auto& [known, factory] : TheRegistry()) names += (names.empty() ? "" : ", ") + known;
  Fail("there is no map processor {}; there are: {}", name, names);
}

}  // namespace airslam
