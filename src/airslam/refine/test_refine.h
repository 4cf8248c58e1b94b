// SPDX-License-Identifier: BSD-3-Clause
//
// Synthetic maps with a round trip and a bit, and what finds loops in them.
#pragma once

#include <memory>
#include <set>

#include "airslam/neural/nearest_matcher.h"
#include "airslam/place/vocabulary_training.h"
#include "airslam/refine/map_tools.h"
#include "airslam/refine/refine.h"
#include "airslam/testing/synthetic_map.h"

namespace airslam {

// A trip of 20 keyframes around the hall, and 5 more of its begin; odometry drifts by some
// decimetres until it is there again.
inline SyntheticMap DriftingMap(double drift = 0.01, int copies = 1) {
  SyntheticMapOptions options;
  options.keyframes = 25;
  options.drift = drift;
  options.drift_angle = 0.1 * drift;
  options.copies = copies;
  return MakeSyntheticMap(options);
}

inline std::shared_ptr<const Vocabulary> TestVocabulary(const Map& map) {
  std::vector<DescriptorMatrix> images;
  for (const auto& [id, keyframe] : map.keyframes) images.push_back(keyframe.descriptors);
  VocabularyOptions options;
  options.levels = 3;
  options.iterations = 5;
  return std::make_shared<Vocabulary>(TrainVocabulary(images, map.model_pack_sha256, options));
}

// The networks' stand-ins for a synthetic map.
struct TestParts {
  explicit TestParts(const Map& map)
      : matcher({.min_cosine = 0.7F, .max_squared_ratio = 1.0F}), vocabulary(TestVocabulary(map)) {}
  RefineParts parts() { return {&matcher, vocabulary}; }
  RefineContext context(const RefineOptions& options, const Map& map) {
    RefineContext made{options, &matcher, vocabulary};
    made.odometry = CollectOdometry(map);
    return made;
  }

  NearestMatcher matcher;
  std::shared_ptr<const Vocabulary> vocabulary;
};

// How far a loop's relative pose is from the truth, metres.
inline double LoopError(const Loop& loop, const SyntheticMap& made) {
  const Rigid3 truth =
      made.true_world_from_cam.at(loop.earlier).Inverse() * made.true_world_from_cam.at(loop.later);
  return (truth.Inverse() * loop.earlier_from_later).translation.norm();
}

}  // namespace airslam
