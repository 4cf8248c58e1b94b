// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/feature/line_matching.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <random>
#include <stdexcept>

namespace airslam {
namespace {

// From the points on each line.
PointLineAssociation Associate(int points, std::vector<std::vector<int>> points_of_line) {
  PointLineAssociation result{std::move(points_of_line), {}};
  result.lines_of_point.resize(points);
  for (std::size_t j = 0; j < result.points_of_line.size(); ++j) {
    for (const int i : result.points_of_line[j]) {
      result.lines_of_point[i].push_back(static_cast<int>(j));
    }
  }
  return result;
}

// Where point i of one image is point i of the other.
std::vector<Match> MatchLines(const PointLineAssociation& image0,
                              const PointLineAssociation& image1,
                              const LineMatchingOptions& options = {}) {
  std::vector<Match> identity;
  for (int i = 0; i < static_cast<int>(image0.lines_of_point.size()); ++i) {
    identity.push_back({i, i, 1});
  }
  return airslam::MatchLines(image0, image1, identity, options);
}

void ExpectMatches(const std::vector<Match>& matches,
                   const std::vector<std::pair<int, int>>& expected) {
  ASSERT_EQ(matches.size(), expected.size());
  for (std::size_t k = 0; k < matches.size(); ++k) {
    EXPECT_EQ(std::pair(matches[k].index0, matches[k].index1), expected[k]) << k;
  }
}

TEST(MatchLines, TheScoreIsTheShareOfTheLineWithFewerPoints) {
  const auto image0 = Associate(10, {{0, 1, 2, 3, 4}});
  const auto image1 = Associate(10, {{5, 6, 7, 8}});
  const std::vector<Match> point_matches = {{0, 7, 1}, {2, 5, 1}, {4, 6, 1}, {1, 9, 1}};
  const std::vector<Match> matches = MatchLines(image0, image1, point_matches);
  ExpectMatches(matches, {{0, 0}});
  EXPECT_FLOAT_EQ(matches[0].score, 0.75f);
}

TEST(MatchLines, BothThresholdsMustBeExceeded) {
  const auto image0 = Associate(8, {{0, 1, 2, 3}});
  const auto image1 = Associate(8, {{0, 1, 4, 5, 6}});
  EXPECT_EQ(MatchLines(image0, image1, {.min_score = 0.49, .min_shared_points = 1}).size(), 1u);
  EXPECT_TRUE(MatchLines(image0, image1, {.min_score = 0.5, .min_shared_points = 1}).empty());
  EXPECT_TRUE(MatchLines(image0, image1, {.min_score = 0.1, .min_shared_points = 2}).empty());
}

TEST(MatchLines, OneToOneAndMoreSharedPointsWin) {
  // Line 0 of image 1 is a piece with all its three points shared; line 1 shares five of seven.
  const auto image0 = Associate(12, {{0, 1, 2, 3, 4, 5, 6, 7}, {9, 10, 11}});
  const auto image1 = Associate(12, {{0, 1, 2}, {3, 4, 5, 6, 7, 8, 9}, {9, 10, 11}});
  ExpectMatches(MatchLines(image0, image1), {{0, 1}, {1, 2}});
}

TEST(MatchLines, OfEquallySharedTheHigherScoreWinsThenTheLowerIndex) {
  const auto image0 = Associate(8, {{0, 1, 2, 3}});
  const auto wide_first = Associate(8, {{0, 1, 4}, {2, 3}});
  ExpectMatches(MatchLines(image0, wide_first), {{0, 1}});
  const auto equal = Associate(8, {{0, 1}, {2, 3}});
  ExpectMatches(MatchLines(image0, equal), {{0, 0}});
  ExpectMatches(MatchLines(equal, image0), {{0, 0}});
}

TEST(MatchLines, DoesNotDependOnTheOrderOfPointMatches) {
  std::mt19937 random(2);
  std::uniform_int_distribution<int> line(0, 29);
  std::vector<std::vector<int>> lines0(30), lines1(30);
  std::vector<Match> point_matches;
  for (int i = 0; i < 300; ++i) {
    const int j = line(random);
    lines0[j].push_back(i);
    lines1[i % 4 == 0 ? line(random) : 29 - j].push_back(299 - i);
    point_matches.push_back({i, 299 - i, 1});
  }
  const auto image0 = Associate(300, lines0), image1 = Associate(300, lines1);
  const std::vector<Match> matches = MatchLines(image0, image1, point_matches);
  EXPECT_GT(matches.size(), 25u);
  for (const Match& m : matches) EXPECT_EQ(m.index1, 29 - m.index0);
  std::shuffle(point_matches.begin(), point_matches.end(), random);
  const std::vector<Match> again = MatchLines(image0, image1, point_matches);
  ASSERT_EQ(again.size(), matches.size());
  for (std::size_t k = 0; k < matches.size(); ++k) {
    EXPECT_EQ(again[k].index0, matches[k].index0);
    EXPECT_EQ(again[k].index1, matches[k].index1);
    EXPECT_EQ(again[k].score, matches[k].score);
  }
}

TEST(MatchLines, FollowsPointsIntoTheRightImage) {
  const std::vector<LineSegment> left = {{100, 50, 100, 250, 1}, {200, 60, 300, 200, 1}};
  const std::vector<LineSegment> right = {{180, 60, 280, 200, 1}, {88, 60, 88, 240, 1}};
  std::vector<Keypoint> in_left = {
      {100, 70, 1}, {101, 150, 1}, {220, 88, 1}, {260, 144, 1}, {99, 200, 1}};
  std::vector<Keypoint> in_right = {{88, 70, 1},
                                    {89, 150, 1},
                                    {200, 88, 1},
                                    {240, 144, 1},
                                    {std::numeric_limits<float>::quiet_NaN(), 200, 1}};
  const std::vector<Match> matches =
      MatchLines(AssociatePoints(in_left, left), AssociatePoints(in_right, right));
  ExpectMatches(matches, {{0, 1}, {1, 0}});
  EXPECT_FLOAT_EQ(matches[0].score, 1);  // of the two points on the right line
}

TEST(MatchLines, EmptyInputsAndWrongIndices) {
  const PointLineAssociation none;
  EXPECT_TRUE(MatchLines(none, none).empty());
  const auto image = Associate(2, {{0, 1}});
  EXPECT_TRUE(MatchLines(image, image, std::span<const Match>()).empty());
  const std::vector<Match> wrong = {{0, 2, 1}};
  EXPECT_THROW(MatchLines(image, image, wrong), std::out_of_range);
}

}  // namespace
}  // namespace airslam
