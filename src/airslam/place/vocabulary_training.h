// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>

#include "airslam/place/vocabulary.h"

namespace airslam {

struct VocabularyOptions {
  int branching = 10;   // children of a node, 2..255
  int levels = 4;       // 1..8; branching ^ levels words at the most
  int iterations = 15;  // of Lloyd's algorithm at every node, >= 1
  std::uint64_t seed = 1;

  // Of junctions: trained on one map (design, section 1; paper, section VI-A).
  static VocabularyOptions Junctions() { return {.levels = 3}; }

  // Throws Error that names the wrong field.
  void Validate() const;
};

// Trains a vocabulary by hierarchical k-means with k-means++ seeding on the unit sphere (cosine),
// then weighs its words by their inverse document frequency. images: the descriptors of one image
// each, rows of unit length and of one size. A node whose descriptors are all alike stays a leaf,
// so few descriptors give few words. Deterministic. Throws Error when there are fewer than two
// different descriptors. progress: called after every node that was split, with the descriptors
// that have reached their word so far.
Vocabulary TrainVocabulary(std::span<const DescriptorMatrix> images,
                           const std::string& network_sha256, const VocabularyOptions& options,
                           const std::function<void(std::int64_t)>& progress = {});

}  // namespace airslam
