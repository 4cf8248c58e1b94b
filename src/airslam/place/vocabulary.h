// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "airslam/map/map_codec.h"
#include "airslam/neural/detections.h"

namespace airslam {

using WordId = std::int32_t;  // running number of the vocabulary's leaves

// How often each word of the vocabulary occurs in an image, weighted by TF-IDF and scaled to an L1
// norm of 1. Ascending words; words of weight zero are left out.
struct WordWeight {
  WordId word = -1;
  float weight = 0;
  bool operator==(const WordWeight&) const = default;
};
using BagOfWords = std::vector<WordWeight>;

// The L1 score of Galvez-Lopez and Tardos (DBoW2), 1 - |a - b|_1 / 2: 1 for equal bags, 0 for bags
// that share no word.
double BagScore(const BagOfWords& a, const BagOfWords& b);

// A tree of cluster centres over unit-length descriptors (hierarchical k-means): a descriptor walks
// from the root to the most similar child (cosine) until it meets a leaf, its word. The keypoint
// vocabulary (10 children, 4 levels) belongs to a model pack, the junction vocabulary (10 children,
// 3 levels) to a map. Immutable, so safe to use from many threads.
class Vocabulary {
 public:
  // A node of the tree in breadth-first order; the root is node 0 and has no centre.
  struct Node {
    std::int32_t first_child = 0;
    std::int32_t children = 0;  // 0: a leaf
  };

  Vocabulary() = default;  // empty: no words

  // children: of each node, breadth first, at most 255. centres: a row for each node but the root,
  // as they are stored, so that a vocabulary read from a file is the same to the bit.
  // network_sha256: of the feature network that made the descriptors. Words weigh 1 until
  // SetWordWeights. Throws Error when the tree is not one.
  Vocabulary(std::span<const int> children, QuantizedDescriptors centres,
             std::string network_sha256);

  // Inverse document frequency, ln(N / N_i), of every word (one a word, 0 to 1e6). Throws Error.
  void SetWordWeights(std::vector<float> weights);

  int words() const { return static_cast<int>(weights_.size()); }
  bool empty() const { return weights_.empty(); }
  int descriptor_size() const { return static_cast<int>(centres_.cols()); }
  const std::string& network_sha256() const { return network_sha256_; }
  std::span<const float> word_weights() const { return weights_; }

  // The word of each descriptor: N x D, rows of unit length. Throws Error on another D.
  std::vector<WordId> Words(const DescriptorMatrix& descriptors) const;

  // TF-IDF bag of an image's words.
  BagOfWords Bag(std::span<const WordId> words) const;

  // Throws Error unless the vocabulary was made for descriptors of this feature network.
  void RequireNetwork(const std::string& sha256, const std::string& whose) const;

  // The content of a vocabulary file (docs/relocalization.md); little-endian.
  std::vector<std::byte> Encode() const;
  // Throws Error that starts with `where` when the bytes are no vocabulary or are damaged.
  static Vocabulary Decode(std::span<const std::byte> bytes, const std::string& where);

  // Encode and Decode of a file. Throw Error that names it.
  void Write(const std::filesystem::path& file) const;
  static Vocabulary Read(const std::filesystem::path& file);

 private:
  WordId Lookup(const float* descriptor) const;

  std::vector<Node> nodes_;
  std::vector<WordId> word_of_node_;  // -1 for inner nodes
  QuantizedDescriptors stored_;       // the centres as they are stored
  DescriptorMatrix centres_;          // row of node i; that of the root is zero
  std::vector<float> weights_;        // of each word
  std::string network_sha256_;
};

}  // namespace airslam
