// SPDX-License-Identifier: BSD-3-Clause
//
// What place recognition costs without the networks: words of 400 descriptors, the query of an
// inverted index, the structure score of one keyframe.
#include <benchmark/benchmark.h>

#include <random>

#include "airslam/place/inverted_index.h"
#include "airslam/place/structure_graph.h"
#include "airslam/place/vocabulary_training.h"

namespace airslam {
namespace {

DescriptorMatrix RandomDescriptors(int count, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<float> normal;
  DescriptorMatrix descriptors(count, 64);
  for (Eigen::Index i = 0; i < descriptors.size(); ++i) descriptors.data()[i] = normal(random);
  descriptors.rowwise().normalize();
  return descriptors;
}

// 10^4 words.
const Vocabulary& FullVocabulary() {
  static const Vocabulary vocabulary = [] {
    const std::vector<DescriptorMatrix> images = {RandomDescriptors(40000, 1)};
    VocabularyOptions options;
    options.iterations = 2;
    return TrainVocabulary(images, "", options);
  }();
  return vocabulary;
}

void Words(benchmark::State& state) {
  const DescriptorMatrix descriptors = RandomDescriptors(400, 2);
  for (auto _ : state) benchmark::DoNotOptimize(FullVocabulary().Words(descriptors));
}
BENCHMARK(Words)->Unit(benchmark::kMicrosecond);

// state.range(0) keyframes of 350 keypoints.
void QueryIndex(benchmark::State& state) {
  const Vocabulary& vocabulary = FullVocabulary();
  InvertedIndex index(vocabulary.words());
  std::mt19937 random(3);
  const auto bag = [&] {
    BagOfWords words;
    for (WordId w = static_cast<WordId>(random() % 29); w < vocabulary.words();
         w += 1 + static_cast<WordId>(random() % 57)) {
      words.push_back({w, 1.0F / 350});
    }
    return words;
  };
  for (KeyframeId id = 0; id < static_cast<KeyframeId>(state.range(0)); ++id) index.Add(id, bag());
  const BagOfWords query = bag();
  for (auto _ : state) benchmark::DoNotOptimize(index.Scores(query));
}
BENCHMARK(QueryIndex)->Arg(100)->Arg(1000)->Arg(10000)->Unit(benchmark::kMicrosecond);

// One keyframe of 60 junctions in 1000 words, each joined to two others.
void Structure(benchmark::State& state) {
  std::mt19937 random(4);
  const auto make = [&](unsigned seed) {
    Junctions junctions{RandomDescriptors(60, seed), {}, {}};
    for (int i = 0; i < 60; ++i) {
      junctions.words.push_back(static_cast<WordId>(random() % 200));
      if (i > 0) junctions.lines.emplace_back(i - 1, i);
    }
    return junctions;
  };
  const Junctions query = make(5), keyframe = make(6);
  for (auto _ : state) benchmark::DoNotOptimize(StructureScore(query, keyframe));
}
BENCHMARK(Structure)->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace airslam

BENCHMARK_MAIN();
