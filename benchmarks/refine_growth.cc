// SPDX-License-Identifier: BSD-3-Clause
//
// How refining grows with the map: copies of a simulated building, visited one after the other,
// each with a round trip and a bit. Prints a markdown table: seconds of each step, peak memory.
//
//   build-bench/bin/refine_growth 1 4 16 64
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <string>

#include "airslam/neural/nearest_matcher.h"
#include "airslam/place/inverted_index.h"
#include "airslam/place/place_index.h"
#include "airslam/place/vocabulary_training.h"
#include "airslam/refine/refine.h"
#include "airslam/testing/synthetic_map.h"

namespace airslam {
namespace {

constexpr int kKeyframesPerBuilding = 60;

SyntheticMap MakeBuildings(int copies) {
  SyntheticMapOptions options;
  options.copies = copies;
  options.keyframes = kKeyframesPerBuilding;
  options.interval = 0.4;  // 50 keyframes a round
  options.drift = 0.003;
  options.drift_angle = 0.0003;
  return MakeSyntheticMap(options);
}

// One vocabulary for all maps, as a model pack has one: of the first building.
std::shared_ptr<const Vocabulary> TrainOnOneBuilding() {
  const SyntheticMap made = MakeBuildings(1);
  std::vector<DescriptorMatrix> images;
  for (const auto& [id, keyframe] : made.map.keyframes) images.push_back(keyframe.descriptors);
  return std::make_shared<Vocabulary>(
      TrainVocabulary(images, made.map.model_pack_sha256, {.iterations = 5}));
}

// Milliseconds to score one keyframe against all.
double QueryMilliseconds(const Map& map, const std::shared_ptr<const Vocabulary>& vocabulary) {
  const PlaceIndex place(map, vocabulary, nullptr);
  std::vector<double> times;
  for (const auto& [id, keyframe] : map.keyframes) {
    const auto start = std::chrono::steady_clock::now();
    const auto words = vocabulary->Words(keyframe.descriptors);
    const auto scores = place.index().Scores(vocabulary->Bag(words));
    if (scores.empty()) return 0;
    times.push_back(
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
            .count());
    if (times.size() == 200) break;
  }
  std::nth_element(times.begin(), times.begin() + times.size() / 2, times.end());
  return times[times.size() / 2];
}

void Measure(int copies, const std::shared_ptr<const Vocabulary>& vocabulary) {
  SyntheticMap made = MakeBuildings(copies);
  const double before = KeyframeError(made.map, made.true_world_from_cam);
  NearestMatcher matcher({.min_cosine = 0.7F, .max_squared_ratio = 1.0F});
  const double query = QueryMilliseconds(made.map, vocabulary);
  const RefineResult result = RefineMap({}, {&matcher, vocabulary}, made.map);
  std::string row = fmt::format("| {} | {} | {} | {} |", copies, made.map.keyframes.size(),
                                made.map.landmarks.size(), result.loops.size());
  for (const auto& step : result.report["steps"]) {
    row += fmt::format(" {:.2f} |", step["seconds"].get<double>());
  }
  fmt::print("{} {:.1f} | {:.0f} | {:.2f} | {:.3f} → {:.3f} |\n", row,
             result.report["seconds"].get<double>(), result.report["memory_peak_mib"].get<double>(),
             query, before, KeyframeError(made.map, made.true_world_from_cam));
}

}  // namespace
}  // namespace airslam

int main(int argc, char** argv) {
  using namespace airslam;
  fmt::print("| buildings | keyframes | landmarks | loops |");
  for (const std::string& name : RefineOptions().ProcessorNames()) fmt::print(" {}, s |", name);
  fmt::print(" all, s | peak, MiB | query, ms | error, m |\n|");
  for (int i = 0; i < 13; ++i) fmt::print("---|");
  fmt::print("\n");
  const auto vocabulary = TrainOnOneBuilding();
  for (int i = 1; i < argc; ++i) Measure(std::max(1, std::atoi(argv[i])), vocabulary);
  return 0;
}
