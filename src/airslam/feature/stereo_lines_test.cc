// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/feature/stereo_lines.h"

#include <gtest/gtest.h>

#include <functional>
#include <opencv2/imgproc.hpp>

#include "airslam/feature/test_texture.h"

namespace airslam {
namespace {

const StereoCamera kStereo = {{200, 200, 160, 120, 320, 240}, 0.1};

// A random texture at a disparity that may differ from place to place.
class StereoLines : public ::testing::Test {
 protected:
  void SetUp() override { left_ = RandomTexture({320, 240}, 11, 2.0, 20, 200); }

  // `disparity` of a row: then a right pixel shows the left one that far to the right of it.
  void Show(const std::function<float(int)>& disparity) {
    cv::Mat x(left_.size(), CV_32FC1), y(left_.size(), CV_32FC1);
    for (int v = 0; v < left_.rows; ++v) {
      for (int u = 0; u < left_.cols; ++u) {
        x.at<float>(v, u) = static_cast<float>(u) + disparity(v);
        y.at<float>(v, u) = static_cast<float>(v);
      }
    }
    cv::remap(left_, right_, x, y, cv::INTER_CUBIC);
  }

  std::vector<LineSegment> Find(const std::vector<LineSegment>& lines) const {
    return FindRightLines(lines, MakePyramid(left_), MakePyramid(right_), kStereo);
  }

  cv::Mat left_, right_;
};

TEST_F(StereoLines, AStandingLineIsFound) {
  Show([](int) { return 15.3f; });
  const std::vector<LineSegment> right = Find({{150, 40, 160, 200, 0.7f}});
  ASSERT_EQ(right.size(), 1u);
  EXPECT_NEAR(right[0].x1, 150 - 15.3, 0.1);
  EXPECT_NEAR(right[0].x2, 160 - 15.3, 0.1);
  EXPECT_EQ(right[0].y1, 40);
  EXPECT_EQ(right[0].y2, 200);
  EXPECT_EQ(right[0].score, 0.7f);
}

TEST_F(StereoLines, ALineThatComesNearerIsFound) {
  // From 8 pixels at the top to 32 at the bottom.
  Show([](int row) { return 8 + 0.1f * static_cast<float>(row); });
  const std::vector<LineSegment> right = Find({{200, 30, 120, 210, 1}});
  ASSERT_GE(right[0].score, 0);
  EXPECT_NEAR(right[0].x1, 200 - 11, 0.2);
  EXPECT_NEAR(right[0].x2, 120 - 29, 0.2);
}

TEST_F(StereoLines, OneThatIsHiddenForAQuarterOfItIsStillFound) {
  Show([](int) { return 15.3f; });
  cv::RNG(4).fill(right_(cv::Rect(100, 40, 80, 36)), cv::RNG::UNIFORM, 0, 255);
  const std::vector<LineSegment> right = Find({{150, 40, 150, 200, 1}});
  ASSERT_GE(right[0].score, 0);
  EXPECT_NEAR(right[0].x1, 150 - 15.3, 0.3);
}

TEST_F(StereoLines, ALineAcrossTwoDepthsIsNone) {
  Show([](int row) { return row < 120 ? 10.0f : 30.0f; });
  EXPECT_LT(Find({{150, 40, 150, 200, 1}})[0].score, 0);
}

TEST_F(StereoLines, ALevelLineSlidesAlongItself) {
  Show([](int) { return 15.3f; });
  EXPECT_LT(Find({{80, 100, 200, 110, 1}})[0].score, 0);
}

TEST_F(StereoLines, WhatIsElsewhereIsNoneAndTheOthersKeepTheirPlaces) {
  Show([](int) { return 15.3f; });
  cv::RNG(8).fill(right_.rowRange(0, 100), cv::RNG::UNIFORM, 0, 255);
  const std::vector<LineSegment> right =
      Find({{150, 10, 150, 90, 1}, {150, 110, 150, 200, 1}, {18, 110, 18, 200, 1}});
  ASSERT_EQ(right.size(), 3u);
  EXPECT_LT(right[0].score, 0);
  EXPECT_GE(right[1].score, 0);
  EXPECT_LT(right[2].score, 0);  // to the left of the right image
  EXPECT_TRUE(Find({}).empty());
}

TEST_F(StereoLines, NothingLiesNearerThanTheLeastDepth) {
  // 20 / 0.3 m = 66.7 pixels.
  Show([](int) { return 90.0f; });
  EXPECT_LT(Find({{200, 40, 200, 200, 1}})[0].score, 0);
  Show([](int) { return 60.0f; });
  EXPECT_GE(Find({{200, 40, 200, 200, 1}})[0].score, 0);
}

}  // namespace
}  // namespace airslam
