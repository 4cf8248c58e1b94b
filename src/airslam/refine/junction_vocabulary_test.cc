// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/refine/junction_vocabulary.h"

#include <gtest/gtest.h>

#include "airslam/refine/test_refine.h"

namespace airslam {
namespace {

TEST(JunctionVocabulary, StoresWordsAndCovisibility) {
  SyntheticMap made = DriftingMap();
  TestParts parts(made.map);
  for (auto& [id, keyframe] : made.map.keyframes) {  // the first ten keypoints are junctions too
    keyframe.junctions.assign(keyframe.keypoints.begin(), keyframe.keypoints.begin() + 10);
    keyframe.junction_descriptors = keyframe.descriptors.topRows(10);
  }
  const RefineOptions options;
  RefineContext context = parts.context(options, made.map);
  JunctionVocabulary().Process(made.map, context);
  ASSERT_TRUE(context.place.has_value());
  EXPECT_EQ(context.place->covisibility, CountCovisibility(made.map));
  EXPECT_FALSE(context.place->junction_vocabulary.empty());
  EXPECT_GT(context.report["junction_words"].get<int>(), 10);
  for (const auto& [id, keyframe] : made.map.keyframes) {
    EXPECT_EQ(context.place->words.at(id).keypoints.size(), keyframe.keypoints.size());
    EXPECT_EQ(context.place->words.at(id).junctions.size(), 10u);
  }
}

TEST(JunctionVocabulary, DoesWithoutJunctionsAndWithoutVocabulary) {
  SyntheticMap made = DriftingMap();
  TestParts parts(made.map);
  const RefineOptions options;
  RefineContext context = parts.context(options, made.map);
  JunctionVocabulary().Process(made.map, context);
  ASSERT_TRUE(context.place.has_value());
  EXPECT_TRUE(context.place->junction_vocabulary.empty());
  RefineContext without{options};
  JunctionVocabulary().Process(made.map, without);
  EXPECT_FALSE(without.place.has_value());
  EXPECT_TRUE(without.report.contains("skipped"));
}

}  // namespace
}  // namespace airslam
