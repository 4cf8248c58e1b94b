// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <vector>

#include "airslam/map/keyframe.h"
#include "airslam/place/vocabulary.h"

namespace airslam {

// A keyframe and how similar it is to a query.
struct ScoredKeyframe {
  KeyframeId id = -1;
  double score = 0;
};

// For every word the keyframes that hold it, so that a query meets only those that share a word
// with it. Reading is safe from many threads; Add is not.
class InvertedIndex {
 public:
  explicit InvertedIndex(int words) : entries_(static_cast<std::size_t>(words)) {}

  // Throws Error when the keyframe is there already, or a word is out of range.
  void Add(KeyframeId id, const BagOfWords& bag);

  // BagScore with every keyframe that shares a word with the query, by ascending id.
  std::vector<ScoredKeyframe> Scores(const BagOfWords& query) const;

  int keyframes() const { return static_cast<int>(ids_.size()); }

 private:
  struct Entry {
    int slot;  // in ids_
    float weight;
  };
  std::vector<std::vector<Entry>> entries_;  // of each word
  std::vector<KeyframeId> ids_;              // in the order of Add
  std::map<KeyframeId, int> slots_;
};

}  // namespace airslam
