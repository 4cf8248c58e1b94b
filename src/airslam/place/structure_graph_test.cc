// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/place/structure_graph.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "airslam/feature/line_refinement.h"

namespace airslam {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;
using testing::Pair;

// Junctions whose descriptors are the given angles on the unit circle.
Junctions AtAngles(std::vector<double> angles, std::vector<WordId> words,
                   std::vector<std::pair<int, int>> lines = {}) {
  Junctions junctions;
  junctions.descriptors.resize(static_cast<Eigen::Index>(angles.size()), 2);
  for (std::size_t i = 0; i < angles.size(); ++i) {
    junctions.descriptors.row(static_cast<Eigen::Index>(i))
        << static_cast<float>(std::cos(angles[i])),
        static_cast<float>(std::sin(angles[i]));
  }
  junctions.words = std::move(words);
  junctions.lines = std::move(lines);
  return junctions;
}

// S_G as the paper writes it, over all n^2 entries.
double DenseStructureScore(const Junctions& query, const Junctions& keyframe) {
  const auto matches = MatchJunctions(query, keyframe);
  const auto joined = [](const Junctions& of, int a, int b) {
    const std::pair<int, int> line = std::minmax(a, b);
    return std::find(of.lines.begin(), of.lines.end(), line) != of.lines.end();
  };
  double sum = 0;
  for (const auto& [q0, k0] : matches) {
    for (const auto& [q1, k1] : matches) {
      sum += joined(query, q0, q1) == joined(keyframe, k0, k1) ? 1 : 0;
    }
  }
  return matches.empty() ? 0 : sum / static_cast<double>(matches.size());
}

TEST(StructureGraphTest, JoinsLinesToTheJunctionsAtTheirEnds) {
  const std::vector<Keypoint> junctions = {{10, 10, 1}, {50, 10, 1}, {50, 40, 1}};
  const std::vector<LineSegment> lines = {{50, 10, 10, 10, 1},         // from junction 1 to 0
                                          {10, 10, 50.4F, 10, 1},      // the same again
                                          {50, 10.3F, 50, 39.8F, 1},   // near enough
                                          {50, 40, 80, 80, 1},         // an end without a junction
                                          {50, 40, 50.2F, 40.2F, 1}};  // both ends at one junction
  EXPECT_THAT(JoinLines(lines, junctions), ElementsAre(Pair(0, 1), Pair(1, 2)));
  EXPECT_THAT(JoinLines({}, junctions), IsEmpty());
}

TEST(StructureGraphTest, EndsThatMovedOntoTheirEdgeKeepTheirJunctions) {
  const std::vector<Keypoint> junctions = {{10, 10, 1}, {50, 10, 1}, {50, 14, 1}};
  const auto moved = static_cast<float>(LineRefinementOptions().reach) - 0.1F;
  EXPECT_THAT(JoinLines(std::vector<LineSegment>{{10, 10 - moved, 50, 11.9F, 1}}, junctions),
              ElementsAre(Pair(0, 1)));
  EXPECT_THAT(JoinLines(std::vector<LineSegment>{{10, 10, 50, 10 - moved - 0.2F, 1}}, junctions),
              IsEmpty());
}

TEST(StructureGraphTest, MatchesOneToOneWithinAWord) {
  const Junctions query = AtAngles({0.0, 0.2, 1.0, 2.0}, {5, 5, 7, 8});
  // 0.15 is nearest to both of word 5; 1.0 exists, but as word 9.
  const Junctions keyframe = AtAngles({1.0, 0.15, 2.3, -0.6}, {9, 5, 8, 5});
  EXPECT_THAT(MatchJunctions(query, keyframe), ElementsAre(Pair(0, 3), Pair(1, 1), Pair(3, 2)));
  EXPECT_THAT(MatchJunctions(query, {}), IsEmpty());
}

TEST(StructureGraphTest, EqualGraphsReachTheNumberOfMatches) {
  const Junctions graph = AtAngles({0, 1, 2, 3}, {0, 1, 2, 3}, {{0, 1}, {1, 2}});
  EXPECT_DOUBLE_EQ(StructureScore(graph, graph), 4);
  EXPECT_DOUBLE_EQ(StructureScore(graph, {}), 0);
}

TEST(StructureGraphTest, EveryDifferentLineCostsTwoEntries) {
  const Junctions query = AtAngles({0, 1, 2, 3}, {0, 1, 2, 3}, {{0, 1}, {1, 2}});
  const Junctions keyframe = AtAngles({3, 2, 1, 0}, {3, 2, 1, 0}, {{0, 1}, {1, 2}});
  // The keyframe's lines are, by the query's numbers, 2-3 and 1-2: two lines differ.
  EXPECT_DOUBLE_EQ(StructureScore(query, keyframe), (16 - 4) / 4.0);
  EXPECT_DOUBLE_EQ(StructureScore(query, keyframe), DenseStructureScore(query, keyframe));
}

TEST(StructureGraphTest, LinesToUnmatchedJunctionsDoNotCount) {
  const Junctions query = AtAngles({0, 1, 2}, {0, 1, 2}, {{0, 1}, {1, 2}});
  const Junctions keyframe = AtAngles({0, 1, 2}, {0, 1, 9}, {{0, 1}});
  EXPECT_DOUBLE_EQ(StructureScore(query, keyframe), 2);
  EXPECT_DOUBLE_EQ(StructureScore(query, keyframe), DenseStructureScore(query, keyframe));
}

}  // namespace
}  // namespace airslam
