// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/place/place_index.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "airslam/map/test_map.h"
#include "airslam/sensor/temporary_folder.h"

namespace airslam {
namespace {

// Six keyframes of 30 keypoints; each with 20 junctions that are its first keypoints, joined in a
// chain. Keyframes 0 and 1 see the same landmarks.
Map SixKeyframes() {
  Map map;
  map.model_pack_sha256 = "network";
  for (KeyframeId id = 0; id < 6; ++id) {
    Keyframe keyframe = TestKeyframe(id, 30, id == 1 ? 0 : 1000 * id);
    keyframe.junctions.assign(keyframe.keypoints.begin(), keyframe.keypoints.begin() + 20);
    keyframe.junction_descriptors = keyframe.descriptors.topRows(20);
    for (std::size_t i = 1; i < 20; ++i) {
      const Keypoint &a = keyframe.junctions[i - 1], &b = keyframe.junctions[i];
      keyframe.lines.push_back({a.x, a.y, b.x, b.y, 1});
      keyframe.right_lines.push_back({0, 0, 0, 0, -1});
      keyframe.line_landmarks.push_back(kNoLandmark);
    }
    for (const Landmark& landmark : TestLandmarks(keyframe)) {
      map.landmarks.emplace(landmark.id, landmark);
    }
    map.keyframes[id] = std::move(keyframe);
  }
  return map;
}

std::shared_ptr<const Vocabulary> KeypointVocabulary(const Map& map, std::uint64_t seed = 1) {
  std::vector<DescriptorMatrix> images;
  for (const auto& [id, keyframe] : map.keyframes) images.push_back(keyframe.descriptors);
  return std::make_shared<Vocabulary>(
      TrainVocabulary(images, map.model_pack_sha256, {.branching = 5, .levels = 3, .seed = seed}));
}

TEST(PlaceIndexTest, KnowsItsOwnKeyframesBest) {
  const Map map = SixKeyframes();
  const PlaceIndex index(map, KeypointVocabulary(map), TrainJunctionVocabulary(map));
  ASSERT_TRUE(index.has_junction_words());
  for (const auto& [id, keyframe] : map.keyframes) {
    double own = 0, best_other = 0;
    for (const ScoredKeyframe& scored : index.index().Scores(index.place(id).keypoint_bag)) {
      (scored.id == id ? own : best_other) =
          std::max(scored.id == id ? own : best_other, scored.score);
    }
    EXPECT_NEAR(own, 1, 1e-5);
    EXPECT_LT(best_other, 0.9);
    EXPECT_EQ(index.place(id).junctions.lines.size(), 19U);
    EXPECT_DOUBLE_EQ(StructureScore(index.place(id).junctions, index.place(id).junctions), 20);
  }
  EXPECT_EQ(index.covisibility().at(0).at(1), 24);
}

TEST(PlaceIndexTest, TheRecordGivesTheSameIndex) {
  const Map map = SixKeyframes();
  const auto vocabulary = KeypointVocabulary(map);
  const PlaceIndex computed(map, vocabulary, TrainJunctionVocabulary(map));
  const PlaceRecord record = computed.Record();
  const PlaceIndex read = PlaceIndex::FromRecord(map, vocabulary, record);
  ASSERT_TRUE(read.has_junction_words());
  EXPECT_EQ(read.covisibility(), computed.covisibility());
  for (const auto& [id, keyframe] : map.keyframes) {
    EXPECT_EQ(read.place(id).keypoint_bag, computed.place(id).keypoint_bag);
    EXPECT_EQ(read.place(id).junction_bag, computed.place(id).junction_bag);
    EXPECT_EQ(read.place(id).junctions.words, computed.place(id).junctions.words);
  }
  EXPECT_EQ(read.Record().words, record.words);
}

TEST(PlaceIndexTest, WordsOfAnotherVocabularyAreComputedAnew) {
  const Map map = SixKeyframes();
  const PlaceRecord record = PlaceIndex(map, KeypointVocabulary(map), nullptr).Record();
  const auto other = KeypointVocabulary(map, 2);
  const PlaceIndex read = PlaceIndex::FromRecord(map, other, record);
  EXPECT_EQ(read.place(3).keypoint_words, other->Words(map.keyframes.at(3).descriptors));
  EXPECT_FALSE(read.has_junction_words());
}

TEST(PlaceIndexTest, DoesWithoutARecordAndWithoutJunctions) {
  Map map = SixKeyframes();
  for (auto& [id, keyframe] : map.keyframes) {
    keyframe.junctions.clear();
    keyframe.junction_descriptors.resize(0, 0);
  }
  EXPECT_EQ(TrainJunctionVocabulary(map), nullptr);
  const PlaceIndex index = PlaceIndex::FromRecord(map, KeypointVocabulary(map), std::nullopt);
  EXPECT_FALSE(index.has_junction_words());
  EXPECT_EQ(index.index().keyframes(), 6);
  EXPECT_TRUE(index.Record().junction_vocabulary.empty());
}

TEST(PlaceIndexTest, RefusesWhatDoesNotFitTheMap) {
  Map map = SixKeyframes();
  const auto vocabulary = KeypointVocabulary(map);
  PlaceRecord record = PlaceIndex(map, vocabulary, nullptr).Record();
  record.words.at(2).keypoints.pop_back();
  EXPECT_THAT(ErrorOf([&] { PlaceIndex::FromRecord(map, vocabulary, record); }),
              testing::HasSubstr("29 words for keyframe 2's 30 keypoints"));
  map.model_pack_sha256 = "another network";
  EXPECT_THAT(ErrorOf([&] { PlaceIndex(map, vocabulary, nullptr); }),
              testing::HasSubstr("train-vocabulary"));
  ModelPack pack;
  pack.name = "bare";
  EXPECT_THAT(ErrorOf([&] { LoadVocabulary(pack); }), testing::HasSubstr("'bare' has no vocab"));
}

}  // namespace
}  // namespace airslam
