// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/feature/point_line_association.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

namespace airslam {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

bool Belongs(const Keypoint& point, const LineSegment& line, const PointLineOptions& options = {}) {
  return !AssociatePoints({&point, 1}, {&line, 1}, options).points_of_line[0].empty();
}

TEST(AssociatePoints, TheDistanceIsLessThanThreePixels) {
  const LineSegment level{100, 50, 200, 50, 1};
  EXPECT_TRUE(Belongs({150, 52.9f, 1}, level));
  EXPECT_TRUE(Belongs({150, 47.1f, 1}, level));
  EXPECT_FALSE(Belongs({150, 53, 1}, level));
  const LineSegment slanted{100, 100, 140, 130, 1};  // (4, 3) / 5
  EXPECT_TRUE(Belongs({120 - 0.59f * 3, 115 + 0.79f * 3, 1}, slanted));
  EXPECT_FALSE(Belongs({120 - 0.61f * 3, 115 + 0.81f * 3, 1}, slanted));
}

TEST(AssociatePoints, TheEndPointsBoundXOrY) {
  const LineSegment slanted{140, 130, 100, 100, 1};
  EXPECT_TRUE(Belongs({100, 100, 1}, slanted));
  EXPECT_TRUE(Belongs({140, 130, 1}, slanted));
  EXPECT_FALSE(Belongs({99.5f, 99.5f, 1}, slanted));    // neither x nor y
  EXPECT_TRUE(Belongs({99.5f, 100.5f, 1}, slanted));    // y only
  EXPECT_TRUE(Belongs({140.5f, 129.5f, 1}, slanted));   // y only
  EXPECT_TRUE(Belongs({100.5f, 99.5f, 1}, slanted));    // x only
  EXPECT_FALSE(Belongs({140.5f, 130.5f, 1}, slanted));  // neither
}

TEST(AssociatePoints, OvershootIsFreeAsInThePaperUnlessBounded) {
  const LineSegment steep{100, 100, 110, 300, 1};
  const Keypoint beyond{110, 345, 1};  // 45 pixels below the end, 2.2 from the line
  EXPECT_TRUE(Belongs(beyond, steep));
  EXPECT_FALSE(Belongs(beyond, steep, {.max_overshoot = 40}));
  EXPECT_TRUE(Belongs(beyond, steep, {.max_overshoot = 50}));
  const LineSegment turned{110, 300, 100, 100, 1};
  EXPECT_FALSE(Belongs(beyond, turned, {.max_overshoot = 40}));
  EXPECT_TRUE(Belongs({105, 200, 1}, turned, {.max_overshoot = 0}));
}

TEST(AssociatePoints, ListsBothWays) {
  const std::vector<LineSegment> lines = {{10, 10, 110, 10, 1}, {50, 0, 50, 100, 1}};
  const std::vector<Keypoint> points = {{50, 11, 1}, {90, 9, 1}, {51, 70, 1}, {300, 300, 1}};
  const PointLineAssociation found = AssociatePoints(points, lines);
  EXPECT_THAT(found.points_of_line, ElementsAre(ElementsAre(0, 1), ElementsAre(0, 2)));
  EXPECT_THAT(found.lines_of_point,
              ElementsAre(ElementsAre(0, 1), ElementsAre(0), ElementsAre(1), IsEmpty()));
}

TEST(AssociatePoints, NothingBelongsToWhatIsNoLineOrNoPoint) {
  EXPECT_FALSE(Belongs({5, 5, 1}, {5, 5, 5, 5, 1}));
  EXPECT_FALSE(Belongs({5, 5, 1}, {kNan, 5, 9, 5, 1}));
  EXPECT_FALSE(Belongs({kNan, 5, 1}, {1, 5, 9, 5, 1}));
  EXPECT_FALSE(Belongs({5, kNan, 1}, {1, 5, 9, 5, 1}));
  const PointLineAssociation none = AssociatePoints({}, {});
  EXPECT_TRUE(none.points_of_line.empty());
  EXPECT_TRUE(none.lines_of_point.empty());
}

TEST(AssociatePoints, FollowsThePapersFormulaForManyPointsAndLines) {
  std::mt19937 random(9);
  std::uniform_real_distribution<float> x(0, 752), y(0, 480);
  std::vector<Keypoint> points;
  std::vector<LineSegment> lines;
  for (int i = 0; i < 400; ++i) points.push_back({x(random), y(random), 1});
  for (int j = 0; j < 100; ++j) {
    lines.push_back({x(random), y(random), x(random), y(random), 1});
  }
  const PointLineAssociation found = AssociatePoints(points, lines);
  int pairs = 0;
  for (int j = 0; j < 100; ++j) {
    const LineSegment& l = lines[j];
    const double a = l.y1 - l.y2, b = l.x2 - l.x1, c = -(a * l.x1 + b * l.y1);
    std::vector<int> expected;
    for (int i = 0; i < 400; ++i) {
      const Keypoint& p = points[i];
      const bool near = std::abs(a * p.x + b * p.y + c) / std::sqrt(a * a + b * b) < 3;
      const bool in_x = std::min(l.x1, l.x2) <= p.x && p.x <= std::max(l.x1, l.x2);
      const bool in_y = std::min(l.y1, l.y2) <= p.y && p.y <= std::max(l.y1, l.y2);
      if (near && (in_x || in_y)) expected.push_back(i);
    }
    EXPECT_EQ(found.points_of_line[j], expected) << j;
    pairs += static_cast<int>(expected.size());
  }
  EXPECT_GT(pairs, 100);
}

}  // namespace
}  // namespace airslam
