// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/place/place_index.h"

#include <utility>

#include "airslam/common/error.h"
#include "airslam/common/sha256.h"

namespace airslam {
namespace {

constexpr int kMaxWords = 65536;  // a stored word has 16 bits

std::string Digest(const Bytes& bytes) {
  Sha256 sha;
  sha.Update(bytes.data(), bytes.size());
  return sha.Hex();
}

std::vector<WordId> FromStored(const std::vector<std::uint16_t>& words, std::size_t features,
                               KeyframeId id, const char* what) {
  if (words.size() != features) {
    Fail("the map's place record has {} words for keyframe {}'s {} {}", words.size(), id, features,
         what);
  }
  return {words.begin(), words.end()};
}

std::vector<std::uint16_t> ToStored(const std::vector<WordId>& words) {
  std::vector<std::uint16_t> stored;
  for (const WordId word : words) stored.push_back(static_cast<std::uint16_t>(word));
  return stored;
}

void RequireFit(const Map& map, const Vocabulary& vocabulary) {
  vocabulary.RequireNetwork(map.model_pack_sha256, "the map");
  if (vocabulary.words() > kMaxWords) {
    Fail("the vocabulary has {} words, a map takes at most {}", vocabulary.words(), kMaxWords);
  }
}

}  // namespace

std::shared_ptr<const Vocabulary> LoadVocabulary(const ModelPack& pack) {
  if (!pack.vocabulary) {
    Fail("the model pack '{}' has no vocabulary: train one with airslam train-vocabulary",
         pack.name);
  }
  auto vocabulary = std::make_shared<Vocabulary>(Vocabulary::Read(pack.vocabulary->path));
  vocabulary->RequireNetwork(pack.features.network.sha256, "the model pack '" + pack.name + "'");
  return vocabulary;
}

std::shared_ptr<const Vocabulary> TrainJunctionVocabulary(const Map& map,
                                                          const VocabularyOptions& options) {
  std::vector<DescriptorMatrix> images;
  Eigen::Index junctions = 0;
  for (const auto& [id, keyframe] : map.keyframes) {
    images.push_back(keyframe.junction_descriptors);
    junctions += keyframe.junction_descriptors.rows();
  }
  // With fewer than this a word would be a single junction.
  constexpr Eigen::Index kFewest = 100;
  if (junctions < kFewest) return nullptr;
  return std::make_shared<Vocabulary>(TrainVocabulary(images, map.model_pack_sha256, options));
}

PlaceIndex::PlaceIndex(const Map& map, std::shared_ptr<const Vocabulary> keypoints,
                       std::shared_ptr<const Vocabulary> junctions, const PlaceRecord* record)
    : vocabulary_(std::move(keypoints)),
      junction_vocabulary_(std::move(junctions)),
      index_(vocabulary_->words()) {
  RequireFit(map, *vocabulary_);
  if (junction_vocabulary_) RequireFit(map, *junction_vocabulary_);
  const bool known =
      record != nullptr && record->vocabulary_sha256 == Digest(vocabulary_->Encode());
  for (const auto& [id, keyframe] : map.keyframes) {
    const PlaceRecord::Words* stored = nullptr;
    if (record != nullptr && record->words.contains(id)) stored = &record->words.at(id);
    Place& place = places_[id];
    place.keypoint_words =
        known && stored != nullptr
            ? FromStored(stored->keypoints, keyframe.keypoints.size(), id, "keypoints")
            : vocabulary_->Words(keyframe.descriptors);
    place.keypoint_bag = vocabulary_->Bag(place.keypoint_words);
    index_.Add(id, place.keypoint_bag);
    if (!junction_vocabulary_) continue;
    place.junctions.descriptors = keyframe.junction_descriptors;
    place.junctions.words =
        stored != nullptr
            ? FromStored(stored->junctions, keyframe.junctions.size(), id, "junctions")
            : junction_vocabulary_->Words(keyframe.junction_descriptors);
    place.junctions.lines = JoinLines(keyframe.lines, keyframe.junctions);
    place.junction_bag = junction_vocabulary_->Bag(place.junctions.words);
  }
  covisibility_ = record != nullptr ? record->covisibility : CountCovisibility(map);
}

PlaceIndex::PlaceIndex(const Map& map, std::shared_ptr<const Vocabulary> keypoints,
                       std::shared_ptr<const Vocabulary> junctions)
    : PlaceIndex(map, std::move(keypoints), std::move(junctions), nullptr) {}

PlaceIndex PlaceIndex::FromRecord(const Map& map, std::shared_ptr<const Vocabulary> keypoints,
                                  const std::optional<PlaceRecord>& record) {
  if (!record) return PlaceIndex(map, std::move(keypoints), nullptr, nullptr);
  std::shared_ptr<const Vocabulary> junctions;
  if (!record->junction_vocabulary.empty()) {
    junctions = std::make_shared<Vocabulary>(
        Vocabulary::Decode(record->junction_vocabulary, "the map's junction vocabulary"));
  }
  return PlaceIndex(map, std::move(keypoints), std::move(junctions), &*record);
}

PlaceRecord PlaceIndex::Record() const {
  PlaceRecord record;
  record.vocabulary_sha256 = Digest(vocabulary_->Encode());
  if (junction_vocabulary_) record.junction_vocabulary = junction_vocabulary_->Encode();
  for (const auto& [id, place] : places_) {
    record.words[id] = {ToStored(place.keypoint_words), ToStored(place.junctions.words)};
  }
  record.covisibility = covisibility_;
  return record;
}

}  // namespace airslam
