// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/common/stage_times.h"

#include <gtest/gtest.h>

#include <thread>
#include <vector>

namespace airslam {
namespace {

TEST(StageTimesTest, SummarizesEachStage) {
  StageTimes times;
  for (int i = 100; i >= 1; --i) times.Record("match", i);
  times.Record("detect", 2.5);
  const auto summary = times.Summarize();
  ASSERT_EQ(summary.size(), 2u);
  const StageTimes::Summary& match = summary.at("match");
  EXPECT_EQ(match.count, 100);
  EXPECT_DOUBLE_EQ(match.total_ms, 5050);
  EXPECT_DOUBLE_EQ(match.mean_ms, 50.5);
  EXPECT_DOUBLE_EQ(match.median_ms, 51);
  EXPECT_DOUBLE_EQ(match.p95_ms, 96);
  EXPECT_DOUBLE_EQ(match.max_ms, 100);
  const StageTimes::Summary& detect = summary.at("detect");
  EXPECT_EQ(detect.count, 1);
  EXPECT_DOUBLE_EQ(detect.median_ms, 2.5);
  EXPECT_DOUBLE_EQ(detect.p95_ms, 2.5);
}

TEST(StageTimesTest, TotalsGrowWithEachRecord) {
  StageTimes times;
  EXPECT_TRUE(times.TotalsMs().empty());
  times.Record("match", 2);
  times.Record("detect", 1.5);
  EXPECT_DOUBLE_EQ(times.TotalsMs().at("match"), 2);
  times.Record("match", 3);
  EXPECT_DOUBLE_EQ(times.TotalsMs().at("match"), 5);
  EXPECT_DOUBLE_EQ(times.TotalsMs().at("detect"), 1.5);
}

TEST(StageTimesTest, EmptyWithoutRecords) { EXPECT_TRUE(StageTimes().Summarize().empty()); }

TEST(StageTimesTest, ScopedStageRecordsOnce) {
  StageTimes times;
  { const ScopedStage stage(times, "read"); }
  const auto summary = times.Summarize();
  EXPECT_EQ(summary.at("read").count, 1);
  EXPECT_GE(summary.at("read").max_ms, 0);
}

TEST(StageTimesTest, ThreadsRecordTogether) {
  StageTimes times;
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([&times] {
      for (int i = 0; i < 1000; ++i) times.Record("shared", 1);
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(times.Summarize().at("shared").count, 4000);
  EXPECT_DOUBLE_EQ(times.Summarize().at("shared").total_ms, 4000);
}

}  // namespace
}  // namespace airslam
