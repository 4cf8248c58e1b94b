// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/feature/stereo_matching.h"

#include <gtest/gtest.h>

#include "airslam/feature/test_texture.h"

namespace airslam {
namespace {

constexpr double kDisparity = 12.4;

// A random texture and the same seen `kDisparity` pixels further left.
class StereoMatching : public ::testing::Test {
 protected:
  void SetUp() override {
    left_ = RandomTexture({240, 120}, 3, 1.6, 0, 255);
    right_image_ = ShiftedLeft(left_, kDisparity);
    left_keypoints_ = {{100, 40, 1}, {150, 60, 1}, {60, 80, 1}};
    stereo_ = {{100, 100, 120, 60, 240, 120}, 0.5};
  }

  std::vector<float> Match(std::span<const float> expected) const {
    const ImagePyramid left = MakePyramid(left_), right = MakePyramid(right_image_);
    return MatchStereo({left, right, left_keypoints_}, stereo_, expected, options_);
  }

  cv::Mat left_, right_image_;
  std::vector<Keypoint> left_keypoints_;
  StereoCamera stereo_;
  StereoMatchingOptions options_;
};

TEST_F(StereoMatching, FindsSubPixelDisparityAlongTheRow) {
  const std::vector<float> right_x = Match({});
  for (std::size_t i = 0; i < left_keypoints_.size(); ++i) {
    EXPECT_NEAR(left_keypoints_[i].x - right_x[i], kDisparity, 0.05) << i;
  }
}

// The second keypoint's surroundings are seen at a second place, too.
TEST_F(StereoMatching, SeeksWhereALandmarkIsExpected) {
  right_image_(cv::Rect(110, 30, 50, 60)).clone().copyTo(right_image_(cv::Rect(74, 30, 50, 60)));
  EXPECT_EQ(Match({})[1], -1);
  const std::vector<float> expected = {-1, 11, -1};
  EXPECT_NEAR(150 - Match(expected)[1], kDisparity, 0.05);
}

// Two places of the left image look like the one of the right image.
TEST_F(StereoMatching, WhatLooksTheSameAtTwoPlacesOfTheLeftImageIsNotFound) {
  left_(cv::Rect(125, 30, 50, 60)).copyTo(left_(cv::Rect(185, 30, 50, 60)));
  left_keypoints_[0] = {210, 60, 1};
  EXPECT_EQ(Match({})[0], -1);
}

TEST_F(StereoMatching, FindsAtHalfResolutionWhatNoiseHides) {
  cv::Mat noise(left_.size(), CV_16SC1);
  cv::RNG random(9);
  for (cv::Mat* image : {&left_, &right_image_}) {
    random.fill(noise, cv::RNG::NORMAL, 0, 55);
    cv::Mat sum;
    image->convertTo(sum, CV_16SC1);
    sum += noise;
    sum.convertTo(*image, CV_8UC1);
  }
  EXPECT_NEAR(100 - Match({})[0], kDisparity, 0.6);
  options_.coarse_below = 0;
  EXPECT_EQ(Match({})[0], -1);
}

TEST_F(StereoMatching, RefusesWhatLooksDifferent) {
  right_image_ = cv::Mat(left_.size(), CV_8UC1);
  cv::RNG(77).fill(right_image_, cv::RNG::UNIFORM, 0, 255);
  for (float x : Match({})) EXPECT_EQ(x, -1);
}

}  // namespace
}  // namespace airslam
