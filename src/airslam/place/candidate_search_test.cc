// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/place/candidate_search.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "airslam/sensor/temporary_folder.h"

namespace airslam {
namespace {

using testing::ElementsAre;

std::vector<KeyframeId> Ids(const std::vector<ScoredKeyframe>& keyframes) {
  std::vector<KeyframeId> ids;
  for (const ScoredKeyframe& keyframe : keyframes) ids.push_back(keyframe.id);
  return ids;
}

void Share(CovisibilityGraph& graph, KeyframeId a, KeyframeId b, int count) {
  graph[a][b] = graph[b][a] = count;
}

TEST(CandidateSearchTest, KeepsAllAboveAShareOfTheBest) {
  const std::vector<ScoredKeyframe> scores = {{1, 0.1}, {2, 0.29}, {3, 1.0}, {4, 0.31}, {5, 0.31}};
  EXPECT_THAT(Ids(KeepHighScores(scores, 0.3)), ElementsAre(3, 4, 5));
  EXPECT_THAT(Ids(KeepHighScores(scores, 0.0)), ElementsAre(3, 4, 5, 2, 1));
  EXPECT_TRUE(KeepHighScores({}, 0.3).empty());
}

TEST(CandidateSearchTest, LoopsAreWithEarlierKeyframesThatShareNothing) {
  CovisibilityGraph graph;
  Share(graph, 10, 9, 1);
  // 12 is later, 9 shares a landmark; neither may set the best score either.
  const std::vector<ScoredKeyframe> scores = {{2, 0.2}, {9, 0.9}, {12, 1.0}, {3, 0.05}};
  EXPECT_THAT(Ids(FindLoopCandidates(scores, 10, graph, {})), ElementsAre(2));
}

TEST(CandidateSearchTest, GroupsByCovisibilityAndTakesEachGroupsBest) {
  CovisibilityGraph graph;
  Share(graph, 1, 2, 11);
  Share(graph, 2, 3, 11);
  Share(graph, 5, 6, 10);  // not more than 10: no group
  const std::vector<ScoredKeyframe> scores = {{1, 0.4}, {2, 0.5}, {3, 0.3}, {5, 0.8}, {6, 0.7}};
  const auto found = FindLoopCandidates(scores, 20, graph, {.max_groups = 3});
  // Group of 2: 1 + 2 + 3 = 1.2; of 1 and 3, with 2 as best again; 5 and 6 alone.
  EXPECT_THAT(Ids(found), ElementsAre(2, 5, 6));
  EXPECT_DOUBLE_EQ(found[0].score, 1.2);
  EXPECT_THAT(Ids(FindLoopCandidates(scores, 20, graph, {.max_groups = 2})), ElementsAre(2, 5));
}

TEST(CandidateSearchTest, OptionsAreChecked) {
  EXPECT_THAT(ErrorOf([] { CandidateOptions{.min_score_share = 1}.Validate(); }),
              testing::HasSubstr("min_score_share"));
  EXPECT_THAT(ErrorOf([] { CandidateOptions{.max_groups = 0}.Validate(); }),
              testing::HasSubstr("max_groups"));
  EXPECT_NO_THROW(CandidateOptions{}.Validate());
}

}  // namespace
}  // namespace airslam
