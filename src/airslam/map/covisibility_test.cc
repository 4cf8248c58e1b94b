// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/map/covisibility.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace airslam {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::Pair;

Map MapOf(const std::map<KeyframeId, std::vector<LandmarkId>>& landmarks) {
  Map map;
  for (const auto& [id, column] : landmarks) {
    map.keyframes[id].id = id;
    map.keyframes[id].landmarks = column;
  }
  return map;
}

TEST(CovisibilityTest, CountsSharedLandmarks) {
  const CovisibilityGraph graph = CountCovisibility(MapOf(
      {{0, {1, 2, 3, kNoLandmark}}, {1, {3, 2, kNoLandmark}}, {4, {3, 9}}, {7, {kNoLandmark, 8}}}));
  EXPECT_THAT(graph, ElementsAre(Pair(0, ElementsAre(Pair(1, 2), Pair(4, 1))),
                                 Pair(1, ElementsAre(Pair(0, 2), Pair(4, 1))),
                                 Pair(4, ElementsAre(Pair(0, 1), Pair(1, 1))), Pair(7, IsEmpty())));
}

TEST(CovisibilityTest, LandmarkNamedTwiceCountsOnce) {
  const CovisibilityGraph graph = CountCovisibility(MapOf({{0, {5, 5}}, {1, {5}}}));
  EXPECT_THAT(graph,
              ElementsAre(Pair(0, ElementsAre(Pair(1, 1))), Pair(1, ElementsAre(Pair(0, 1)))));
}

TEST(CovisibilityTest, NeighboursAreOrderedByCountThenId) {
  const CovisibilityGraph graph =
      CountCovisibility(MapOf({{0, {1, 2}}, {1, {1}}, {2, {1, 2}}, {3, {2}}}));
  EXPECT_THAT(NeighboursByCount(graph, 0), ElementsAre(Pair(2, 2), Pair(1, 1), Pair(3, 1)));
  EXPECT_THAT(NeighboursByCount(graph, 99), IsEmpty());
}

}  // namespace
}  // namespace airslam
