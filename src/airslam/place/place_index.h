// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "airslam/map/covisibility.h"
#include "airslam/map/map.h"
#include "airslam/map/place_record.h"
#include "airslam/neural/model_pack.h"
#include "airslam/place/inverted_index.h"
#include "airslam/place/structure_graph.h"
#include "airslam/place/vocabulary.h"
#include "airslam/place/vocabulary_training.h"

namespace airslam {

// The keypoint vocabulary of a model pack. Throws Error when the pack has none, or it belongs to
// another feature network than the pack's.
std::shared_ptr<const Vocabulary> LoadVocabulary(const ModelPack& pack);

// The vocabulary of a map's own junctions (design, section 1: 3 levels x 10). Nothing when the map
// has too few junctions.
std::shared_ptr<const Vocabulary> TrainJunctionVocabulary(
    const Map& map, const VocabularyOptions& options = VocabularyOptions::Junctions());

// All that place recognition knows of a map: the words of each keyframe's keypoints and junctions,
// the inverted index and the co-visibility of keyframes. Holds no reference to the map. Immutable,
// so safe to use from many threads.
class PlaceIndex {
 public:
  // What the index keeps of one keyframe.
  struct Place {
    std::vector<WordId> keypoint_words;  // of each keypoint
    BagOfWords keypoint_bag;
    Junctions junctions;  // with their words and lines; empty without a junction vocabulary
    BagOfWords junction_bag;
  };

  // Computes the words of a map's keyframes. `junctions` may be null. Throws Error when a
  // vocabulary does not belong to the map's feature network or has more than 65,536 words.
  PlaceIndex(const Map& map, std::shared_ptr<const Vocabulary> keypoints,
             std::shared_ptr<const Vocabulary> junctions);

  // Takes the words from the map's place record where it has one that was made with this
  // vocabulary, and computes them elsewhere. Throws Error when the record does not fit the map.
  static PlaceIndex FromRecord(const Map& map, std::shared_ptr<const Vocabulary> keypoints,
                               const std::optional<PlaceRecord>& record);

  // What a map file keeps of this.
  PlaceRecord Record() const;

  bool has_junction_words() const { return junction_vocabulary_ != nullptr; }
  const Vocabulary& vocabulary() const { return *vocabulary_; }
  const Vocabulary& junction_vocabulary() const { return *junction_vocabulary_; }
  // Throws std::out_of_range for an unknown keyframe.
  const Place& place(KeyframeId id) const { return places_.at(id); }
  const InvertedIndex& index() const { return index_; }
  const CovisibilityGraph& covisibility() const { return covisibility_; }

 private:
  PlaceIndex(const Map& map, std::shared_ptr<const Vocabulary> keypoints,
             std::shared_ptr<const Vocabulary> junctions, const PlaceRecord* record);

  std::shared_ptr<const Vocabulary> vocabulary_;
  std::shared_ptr<const Vocabulary> junction_vocabulary_;  // null: none
  std::map<KeyframeId, Place> places_;
  InvertedIndex index_;
  CovisibilityGraph covisibility_;
};

}  // namespace airslam
