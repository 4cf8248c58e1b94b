// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/place/vocabulary.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "airslam/sensor/temporary_folder.h"

namespace airslam {
namespace {

// Two branches along +x and +y; the first has two leaves, tilted to +z and -z.
Vocabulary SmallVocabulary() {
  DescriptorMatrix centres(4, 3);
  centres << 1, 0, 0, 0, 1, 0, 0.8F, 0, 0.6F, 0.8F, 0, -0.6F;
  const std::vector<int> children = {2, 2, 0, 0, 0};
  return Vocabulary(children, QuantizeDescriptors(centres), std::string(64, 'a'));
}

DescriptorMatrix Rows(const std::vector<std::vector<float>>& rows) {
  DescriptorMatrix matrix(static_cast<Eigen::Index>(rows.size()), 3);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    for (std::size_t d = 0; d < 3; ++d) {
      matrix(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(d)) = rows[i][d];
    }
  }
  matrix.rowwise().normalize();
  return matrix;
}

TEST(VocabularyTest, WalksToTheMostSimilarLeaf) {
  const Vocabulary vocabulary = SmallVocabulary();
  EXPECT_EQ(vocabulary.words(), 3);
  EXPECT_EQ(vocabulary.descriptor_size(), 3);
  const auto words = vocabulary.Words(Rows({{0.1F, 1, 0}, {1, 0, 0.2F}, {1, 0.1F, -0.2F}}));
  EXPECT_EQ(words, (std::vector<WordId>{0, 1, 2}));
}

TEST(VocabularyTest, WeighsWordsByTheirNumberAndFrequency) {
  Vocabulary vocabulary = SmallVocabulary();
  vocabulary.SetWordWeights({2, 1, 0});
  const std::vector<WordId> words = {1, 0, 2, 1};
  const BagOfWords bag = vocabulary.Bag(words);
  EXPECT_EQ(bag, (BagOfWords{{0, 0.5F}, {1, 0.5F}}));
  EXPECT_TRUE(vocabulary.Bag({}).empty());
  const std::vector<WordId> wrong = {3};
  EXPECT_EQ(ErrorOf([&] { vocabulary.Bag(wrong); }), "word 3 is not one of the vocabulary's 3");
}

TEST(VocabularyTest, ScoresAsOneMinusHalfTheL1Distance) {
  const BagOfWords a = {{1, 0.25F}, {4, 0.75F}};
  const BagOfWords b = {{1, 0.5F}, {3, 0.25F}, {4, 0.25F}};
  // |0.25 - 0.5| + |0 - 0.25| + |0.75 - 0.25| = 1
  EXPECT_DOUBLE_EQ(BagScore(a, b), 0.5);
  EXPECT_DOUBLE_EQ(BagScore(a, a), 1);
  EXPECT_DOUBLE_EQ(BagScore(a, {{2, 1}}), 0);
}

TEST(VocabularyTest, ComesBackFromItsFileToTheBit) {
  const TemporaryFolder folder;
  Vocabulary vocabulary = SmallVocabulary();
  vocabulary.SetWordWeights({2, 1, 0.5F});
  vocabulary.Write(folder.path() / "v.bin");
  const Vocabulary read = Vocabulary::Read(folder.path() / "v.bin");
  EXPECT_EQ(read.Encode(), vocabulary.Encode());
  EXPECT_EQ(read.network_sha256(), std::string(64, 'a'));
  EXPECT_EQ(read.word_weights()[1], 1);
  const DescriptorMatrix descriptors = Rows({{0.1F, 1, 0}, {1, 0, 0.2F}});
  EXPECT_EQ(read.Words(descriptors), vocabulary.Words(descriptors));
}

TEST(VocabularyTest, NamesWhatIsWrongWithAFile) {
  const Bytes good = SmallVocabulary().Encode();
  const auto decode = [](const Bytes& bytes) {
    return ErrorOf([&] { Vocabulary::Decode(bytes, "v.bin"); });
  };
  EXPECT_EQ(decode(Bytes(good.begin(), good.begin() + 20)),
            "v.bin: not a vocabulary: it has 20 bytes");
  Bytes bytes = good;
  bytes[0] = std::byte{'X'};
  EXPECT_EQ(decode(bytes), "v.bin: not a vocabulary");
  bytes = good;
  bytes[8] = std::byte{9};
  EXPECT_THAT(decode(bytes), testing::HasSubstr("version 9, this program reads version 1"));
  bytes = good;
  bytes.pop_back();
  EXPECT_THAT(decode(bytes), testing::HasSubstr("truncated or damaged"));
  bytes = good;
  bytes[96] = std::byte{1};  // the root's children
  EXPECT_THAT(decode(bytes), testing::HasSubstr("do not make a tree"));
  bytes = good;
  bytes[12] = std::byte{0xff};  // the descriptor size
  EXPECT_THAT(decode(bytes), testing::HasSubstr("truncated or damaged"));
  bytes = good;
  bytes[40] = std::byte{0};  // in the digest
  EXPECT_THAT(decode(bytes), testing::HasSubstr("something follows the digest"));
  bytes = good;
  bytes[bytes.size() - 1] = std::byte{0x7e};  // a weight of more than 1e37
  EXPECT_THAT(decode(bytes), testing::HasSubstr("a word cannot weigh"));
  EXPECT_THAT(ErrorOf([] { Vocabulary::Read("/nowhere/v.bin"); }),
              testing::HasSubstr("/nowhere/v.bin"));
}

TEST(VocabularyTest, RefusesDescriptorsOfAnotherNetworkOrSize) {
  const Vocabulary vocabulary = SmallVocabulary();
  EXPECT_NO_THROW(vocabulary.RequireNetwork(std::string(64, 'a'), "the map"));
  EXPECT_THAT(ErrorOf([&] { vocabulary.RequireNetwork(std::string(64, 'b'), "the map"); }),
              testing::HasSubstr("not on those of the map, bbbbbbbbbbbb"));
  EXPECT_THAT(ErrorOf([&] { vocabulary.Words(DescriptorMatrix::Zero(1, 4)); }),
              testing::HasSubstr("of 3 values, not of 4"));
  EXPECT_TRUE(vocabulary.Words(DescriptorMatrix()).empty());
}

}  // namespace
}  // namespace airslam
