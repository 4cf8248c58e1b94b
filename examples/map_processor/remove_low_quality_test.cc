// SPDX-License-Identifier: BSD-3-Clause
#include "remove_low_quality.h"

#include <gtest/gtest.h>

#include "airslam/refine/map_tools.h"
#include "airslam/refine/refine.h"
#include "airslam/testing/synthetic_map.h"

namespace {

TEST(RemoveLowQuality, KeepsWhatManySeeWhereItIs) {
  airslam::SyntheticMap made = airslam::MakeSyntheticMap({});
  const auto before = airslam::CollectObservations(made.map);
  airslam::LandmarkId displaced = airslam::kNoLandmark;
  for (const auto& [id, seen_by] : before) {
    if (seen_by.size() >= 5) displaced = id;
  }
  ASSERT_NE(displaced, airslam::kNoLandmark);
  made.map.landmarks.at(displaced).point_in_world.z() += 1;

  airslam::RegisterMapProcessor("remove_low_quality",
                                [] { return std::make_unique<RemoveLowQuality>(); });
  airslam::RefineOptions options;
  options.processors = "remove_low_quality";
  const airslam::RefineResult result = airslam::RefineMap(options, {}, made.map);

  EXPECT_FALSE(made.map.landmarks.contains(displaced));
  const auto after = airslam::CollectObservations(made.map);
  EXPECT_GT(after.size(), 50u);
  EXPECT_EQ(after.size(), made.map.landmarks.size());
  for (const auto& [id, seen_by] : after) EXPECT_GE(seen_by.size(), 3u);
  EXPECT_EQ(result.report["steps"][0]["removed"], before.size() - after.size());
}

}  // namespace
