// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/place/inverted_index.h"

#include <algorithm>

#include "airslam/common/error.h"

namespace airslam {

void InvertedIndex::Add(KeyframeId id, const BagOfWords& bag) {
  const int slot = keyframes();
  for (const WordWeight& entry : bag) {
    if (entry.word < 0 || entry.word >= static_cast<WordId>(entries_.size())) {
      Fail("keyframe {} has word {}, the vocabulary only {}", id, entry.word, entries_.size());
    }
  }
  if (!slots_.emplace(id, slot).second) Fail("keyframe {} is in the index already", id);
  ids_.push_back(id);
  for (const WordWeight& entry : bag) {
    entries_[static_cast<std::size_t>(entry.word)].push_back({slot, entry.weight});
  }
}

std::vector<ScoredKeyframe> InvertedIndex::Scores(const BagOfWords& query) const {
  std::vector<double> scores(ids_.size(), 0);
  for (const WordWeight& entry : query) {
    if (entry.word < 0 || entry.word >= static_cast<WordId>(entries_.size())) {
      Fail("the query has word {}, the vocabulary only {}", entry.word, entries_.size());
    }
    for (const Entry& held : entries_[static_cast<std::size_t>(entry.word)]) {
      scores[static_cast<std::size_t>(held.slot)] += std::min(entry.weight, held.weight);
    }
  }
  std::vector<ScoredKeyframe> result;
  for (const auto& [id, slot] : slots_) {  // ascending ids, whatever the order of Add was
    const double score = scores[static_cast<std::size_t>(slot)];
    if (score > 0) result.push_back({id, score});
  }
  return result;
}

}  // namespace airslam
