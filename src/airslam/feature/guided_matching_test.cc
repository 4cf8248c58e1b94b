// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/feature/guided_matching.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <set>

namespace airslam {
namespace {

TEST(KeypointGrid, FindsWhatAFullSearchFinds) {
  std::mt19937 random(5);
  std::uniform_real_distribution<float> x(0, 319), y(0, 239);
  std::vector<Keypoint> keypoints;
  for (int i = 0; i < 500; ++i) keypoints.push_back({x(random), y(random), 0});
  const KeypointGrid grid(keypoints, 320, 240);
  for (const double radius : {0.5, 7.0, 40.0, 1000.0}) {
    const Eigen::Vector2d center(x(random), y(random));
    std::multiset<int> found, expected;
    grid.VisitNear(center, radius, [&](int i) { found.insert(i); });
    for (int i = 0; i < 500; ++i) {
      const Eigen::Vector2d p(keypoints[i].x, keypoints[i].y);
      if ((p - center).norm() <= radius) expected.insert(i);
    }
    EXPECT_EQ(found, expected) << radius;
  }
}

DescriptorMatrix OneHot(std::initializer_list<int> columns) {
  DescriptorMatrix m = DescriptorMatrix::Zero(static_cast<int>(columns.size()), 8);
  int row = 0;
  for (int column : columns) m(row++, column) = 1;
  return m;
}

TEST(GuidedMatching, TakesTheSimilarWithinTheRadius) {
  const std::vector<Keypoint> keypoints = {{10, 10, 0}, {14, 10, 0}, {90, 10, 0}};
  const KeypointGrid grid(keypoints, 100, 100);
  const DescriptorMatrix seen = OneHot({3, 1, 2});
  const std::vector<Expectation> expectations = {{0, {12, 12}}, {1, {12, 12}}};
  const auto matches = MatchExpectations(expectations, OneHot({1, 2}), grid, seen, {20, 0.5});
  // Expectation 0 looks like keypoint 1; the only look-alike of expectation 1 is too far away.
  ASSERT_EQ(matches.size(), 1u);
  EXPECT_EQ(matches[0].index0, 0);
  EXPECT_EQ(matches[0].index1, 1);
}

TEST(GuidedMatching, GivesAKeypointToTheMostSimilar) {
  const std::vector<Keypoint> keypoints = {{10, 10, 0}};
  const KeypointGrid grid(keypoints, 100, 100);
  DescriptorMatrix expected(2, 8);
  expected.setZero();
  expected(0, 1) = 0.8f;
  expected(0, 2) = 0.6f;
  expected(1, 1) = 1;
  const std::vector<Expectation> expectations = {{0, {10, 10}}, {1, {10, 10}}};
  const auto matches = MatchExpectations(expectations, expected, grid, OneHot({1}), {20, 0.5});
  ASSERT_EQ(matches.size(), 1u);
  EXPECT_EQ(matches[0].index0, 1);
}

}  // namespace
}  // namespace airslam
