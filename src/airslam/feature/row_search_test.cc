// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/feature/row_search.h"

#include <gtest/gtest.h>

#include "airslam/feature/test_texture.h"

namespace airslam {
namespace {

constexpr double kShift = 20.4;

// A random texture, and the same seen kShift pixels further left.
class RowSearch : public ::testing::Test {
 protected:
  void SetUp() override {
    reference_ = RandomTexture({160, 60}, 5, 1.5, 20, 120);
    image_ = ShiftedLeft(reference_, kShift);
  }

  std::optional<double> Search(int column, int row, int first = 0, int last = 159) const {
    return SearchRow(reference_, image_, column, row, first, last, options_);
  }

  cv::Mat reference_, image_;
  RowSearchOptions options_;
};

TEST_F(RowSearch, FindsThePatchBetweenTwoColumns) {
  for (int column = 40; column < 150; column += 7) {
    const auto found = Search(column, 30);
    ASSERT_TRUE(found) << column;
    EXPECT_NEAR(*found, column - kShift, 0.15) << column;
  }
}

TEST_F(RowSearch, GainAndOffsetOfTheLightDoNotMatter) {
  const auto before = Search(80, 30);
  image_.convertTo(image_, CV_8UC1, 1.7, 30);
  const auto after = Search(80, 30);
  ASSERT_TRUE(before && after);
  EXPECT_NEAR(*after, *before, 0.05);
}

TEST_F(RowSearch, FindsNothingOutsideTheRange) {
  EXPECT_TRUE(Search(80, 30, 50, 70));
  options_.min_correlation = 0.8;  // chance gets near 0.6
  EXPECT_FALSE(Search(80, 30, 65, 100));
  EXPECT_FALSE(Search(80, 30, 70, 50));
  // The best place is the last one that is looked at: a better one may lie beyond.
  EXPECT_FALSE(Search(80, 30, 50, 59));
}

TEST_F(RowSearch, FindsNothingAtTheBorder) {
  EXPECT_FALSE(Search(80, 4));
  EXPECT_TRUE(Search(80, 5));
  EXPECT_FALSE(Search(80, 55));
  EXPECT_FALSE(Search(4, 30));
  EXPECT_FALSE(Search(155, 30));
  EXPECT_FALSE(Search(22, 30));  // its partner's patch would begin before the first column
}

TEST_F(RowSearch, FindsNothingWithoutTexture) {
  cv::RNG random(2);
  random.fill(reference_, cv::RNG::UNIFORM, 100, 102);
  random.fill(image_, cv::RNG::UNIFORM, 100, 102);
  EXPECT_FALSE(Search(80, 30));
}

TEST_F(RowSearch, WhatIsThereTwiceIsAmbiguous) {
  image_.colRange(45, 75).copyTo(image_.colRange(105, 135));
  EXPECT_FALSE(Search(80, 30));
  EXPECT_TRUE(Search(80, 30, 40, 90));
}

TEST_F(RowSearch, WhatLooksDifferentIsNotFound) {
  cv::RNG(77).fill(image_, cv::RNG::UNIFORM, 0, 255);
  EXPECT_FALSE(Search(80, 30));
}

}  // namespace
}  // namespace airslam
