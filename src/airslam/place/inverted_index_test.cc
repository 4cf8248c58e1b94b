// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/place/inverted_index.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "airslam/sensor/temporary_folder.h"

namespace airslam {
namespace {

BagOfWords RandomBag(int words, int entries, std::mt19937& random) {
  std::vector<float> weights(static_cast<std::size_t>(words), 0.0F);
  for (int i = 0; i < entries; ++i) {
    weights[random() % weights.size()] += 1.0F / static_cast<float>(entries);
  }
  BagOfWords bag;
  for (int w = 0; w < words; ++w) {
    if (weights[static_cast<std::size_t>(w)] > 0) {
      bag.push_back({w, weights[static_cast<std::size_t>(w)]});
    }
  }
  return bag;
}

TEST(InvertedIndexTest, ScoresAsComparingEveryPairOfBags) {
  std::mt19937 random(3);
  InvertedIndex index(50);
  std::map<KeyframeId, BagOfWords> bags;
  for (const KeyframeId id : {7, 3, 12, 5}) {  // in any order
    bags[id] = RandomBag(50, 12, random);
    index.Add(id, bags[id]);
  }
  EXPECT_EQ(index.keyframes(), 4);
  const BagOfWords query = RandomBag(50, 20, random);
  const std::vector<ScoredKeyframe> scores = index.Scores(query);
  std::size_t found = 0;
  for (const auto& [id, bag] : bags) {
    const double expected = BagScore(query, bag);
    if (expected == 0) continue;
    ASSERT_LT(found, scores.size());
    EXPECT_EQ(scores[found].id, id);
    EXPECT_NEAR(scores[found].score, expected, 1e-6);
    ++found;
  }
  EXPECT_EQ(found, scores.size());
  EXPECT_GE(found, 3U);
}

TEST(InvertedIndexTest, LeavesOutWhatSharesNoWord) {
  InvertedIndex index(3);
  index.Add(1, {{0, 1}});
  index.Add(2, {{1, 0.5F}, {2, 0.5F}});
  const auto scores = index.Scores({{2, 1}});
  ASSERT_EQ(scores.size(), 1U);
  EXPECT_EQ(scores[0].id, 2);
  EXPECT_TRUE(index.Scores({}).empty());
}

TEST(InvertedIndexTest, RefusesDoublesAndUnknownWords) {
  InvertedIndex index(3);
  index.Add(1, {{0, 1}});
  EXPECT_THAT(ErrorOf([&] { index.Add(1, {{0, 1}}); }), testing::HasSubstr("keyframe 1"));
  EXPECT_THAT(ErrorOf([&] { index.Add(2, {{3, 1}}); }), testing::HasSubstr("word 3"));
  EXPECT_EQ(index.keyframes(), 1);
  EXPECT_THAT(ErrorOf([&] { index.Scores({{-1, 1}}); }), testing::HasSubstr("word -1"));
}

}  // namespace
}  // namespace airslam
