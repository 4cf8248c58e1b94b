// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/place/vocabulary_training.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <set>

#include "airslam/sensor/temporary_folder.h"

namespace airslam {
namespace {

constexpr int kSize = 16;

// `count` descriptors around each of `centres` directions that are far apart.
DescriptorMatrix ScatteredDescriptors(int centres, int count, unsigned seed, double noise = 0.02) {
  std::mt19937 random(7);  // the directions are the same for every seed
  std::normal_distribution<float> normal;
  DescriptorMatrix directions(centres, kSize);
  for (Eigen::Index i = 0; i < directions.size(); ++i) directions.data()[i] = normal(random);
  directions.rowwise().normalize();
  random.seed(seed);
  DescriptorMatrix descriptors(centres * count, kSize);
  for (int i = 0; i < centres * count; ++i) {
    for (int d = 0; d < kSize; ++d) {
      descriptors(i, d) = directions(i % centres, d) + static_cast<float>(noise) * normal(random);
    }
  }
  descriptors.rowwise().normalize();
  return descriptors;
}

TEST(VocabularyTrainingTest, FindsTheClusters) {
  const std::vector<DescriptorMatrix> images = {ScatteredDescriptors(9, 20, 1)};
  const Vocabulary vocabulary =
      TrainVocabulary(images, "sha", {.branching = 3, .levels = 2, .iterations = 20});
  EXPECT_EQ(vocabulary.words(), 9);
  EXPECT_EQ(vocabulary.network_sha256(), "sha");
  // What lies near one direction gets one word, other directions mostly others.
  const std::vector<WordId> words = vocabulary.Words(ScatteredDescriptors(9, 2, 2));
  std::set<WordId> different;
  for (std::size_t i = 0; i < 9; ++i) {
    EXPECT_EQ(words[i], words[i + 9]);
    different.insert(words[i]);
  }
  EXPECT_GE(different.size(), 7U);
}

TEST(VocabularyTrainingTest, WordsOfEveryImageWeighNothing) {
  // The first image lacks the last three directions.
  const DescriptorMatrix all = ScatteredDescriptors(3, 10, 1);
  DescriptorMatrix some(10, kSize);
  for (int i = 0; i < 10; ++i) some.row(i) = all.row(3 * i);
  const std::vector<DescriptorMatrix> images = {all, some};
  const Vocabulary vocabulary =
      TrainVocabulary(images, "sha", {.branching = 3, .levels = 1, .iterations = 20});
  ASSERT_EQ(vocabulary.words(), 3);
  const std::vector<WordId> words = vocabulary.Words(all.topRows(3));
  EXPECT_EQ(vocabulary.word_weights()[words[0]], 0);
  EXPECT_FLOAT_EQ(vocabulary.word_weights()[words[1]], std::log(2.0F));
  EXPECT_FLOAT_EQ(vocabulary.word_weights()[words[2]], std::log(2.0F));
}

TEST(VocabularyTrainingTest, RepeatsToTheBitAndFollowsTheSeed) {
  const std::vector<DescriptorMatrix> images = {ScatteredDescriptors(40, 5, 1, 0.1),
                                                ScatteredDescriptors(40, 5, 2, 0.1)};
  const VocabularyOptions options = {.branching = 4, .levels = 3};
  const Bytes first = TrainVocabulary(images, "sha", options).Encode();
  EXPECT_EQ(TrainVocabulary(images, "sha", options).Encode(), first);
  VocabularyOptions other = options;
  other.seed = 2;
  EXPECT_NE(TrainVocabulary(images, "sha", other).Encode(), first);
}

TEST(VocabularyTrainingTest, ReportsProgressUpToTheLastDescriptor) {
  const std::vector<DescriptorMatrix> images = {ScatteredDescriptors(9, 20, 1)};
  std::int64_t last = 0;
  TrainVocabulary(images, "sha", {.branching = 3, .levels = 2}, [&](std::int64_t done) {
    EXPECT_GE(done, last);
    last = done;
  });
  EXPECT_EQ(last, 180);
}

TEST(VocabularyTrainingTest, FewDescriptorsGiveFewWords) {
  const std::vector<DescriptorMatrix> images = {ScatteredDescriptors(5, 1, 1),
                                                ScatteredDescriptors(5, 1, 1)};
  EXPECT_EQ(TrainVocabulary(images, "sha", VocabularyOptions::Junctions()).words(), 5);
}

TEST(VocabularyTrainingTest, SaysWhatItCannotTrainOn) {
  const std::vector<DescriptorMatrix> nothing(3);
  EXPECT_THAT(ErrorOf([&] { TrainVocabulary(nothing, "sha", {}); }),
              testing::HasSubstr("0 descriptors are too few"));
  const std::vector<DescriptorMatrix> alike = {ScatteredDescriptors(1, 9, 1, 0)};
  EXPECT_THAT(ErrorOf([&] { TrainVocabulary(alike, "sha", {}); }), testing::HasSubstr("too alike"));
  const std::vector<DescriptorMatrix> sizes = {DescriptorMatrix::Identity(2, 2),
                                               DescriptorMatrix::Identity(3, 3)};
  EXPECT_THAT(ErrorOf([&] { TrainVocabulary(sizes, "sha", {}); }),
              testing::HasSubstr("of 2 and of 3 values"));
  EXPECT_THAT(ErrorOf([&] { TrainVocabulary(sizes, "sha", {.levels = 0}); }),
              testing::HasSubstr("levels = 0 must be 1 to 8"));
}

}  // namespace
}  // namespace airslam
