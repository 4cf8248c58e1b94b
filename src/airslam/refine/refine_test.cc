// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/refine/refine.h"

#include <gtest/gtest.h>

#include "airslam/common/error.h"
#include "airslam/refine/test_refine.h"

namespace airslam {
namespace {

TEST(Refine, ALoopTakesMostOfTheDriftAway) {
  for (const double drift : {0.005, 0.02}) {
    SyntheticMap made = DriftingMap(drift);
    const double before = KeyframeError(made.map, made.true_world_from_cam);
    TestParts parts(made.map);
    const RefineResult result = RefineMap({}, parts.parts(), made.map);
    const double after = KeyframeError(made.map, made.true_world_from_cam);
    EXPECT_GE(result.loops.size(), 5u);
    EXPECT_LT(after, 0.5 * before) << before << " m before";
    EXPECT_LT(result.report["after"]["loop_errors"]["rms_position_m"].get<double>(), 0.05);
    EXPECT_TRUE(result.place.has_value());
  }
}

TEST(Refine, TheReportNamesEveryStepInItsOrder) {
  SyntheticMap made = DriftingMap();
  TestParts parts(made.map);
  RefineOptions options;
  options.processors = "pose_graph,loop_closure , merge";
  const RefineResult result = RefineMap(options, parts.parts(), made.map);
  ASSERT_EQ(result.report["steps"].size(), 3u);
  EXPECT_EQ(result.report["steps"][0]["name"], "pose_graph");
  EXPECT_EQ(result.report["steps"][0]["skipped"], "no loops");
  EXPECT_EQ(result.report["steps"][1]["name"], "loop_closure");
  EXPECT_GT(result.report["steps"][1]["loops"].size(), 0u);
  for (const auto& step : result.report["steps"]) {
    EXPECT_GE(step["seconds"].get<double>(), 0);
    EXPECT_GT(step["memory_peak_mib"].get<double>(), 1);
    EXPECT_EQ(step["after"]["keyframes"], 25);
  }
  EXPECT_LT(result.report["after"]["landmarks"], result.report["before"]["landmarks"]);
  EXPECT_FALSE(result.place.has_value());
}

TEST(Refine, TheObserverHearsOfEveryProcessorAndMayEndIt) {
  SyntheticMap made = DriftingMap();
  TestParts parts(made.map);
  RefineOptions options;
  options.processors = "loop_closure, merge, pose_graph, global_bundle";
  std::vector<std::string> ended;
  std::map<std::string, int> words;
  RefineMap(options, parts.parts(), made.map, [&](const RefineProgress& progress) {
    const std::string name(progress.processor);
    EXPECT_LE(progress.done, progress.total);
    if (progress.ended) {
      ended.push_back(name);
    } else {
      ++words[name];
    }
  });
  EXPECT_EQ(ended, options.ProcessorNames());
  EXPECT_EQ(words["loop_closure"], 25);
  for (const std::string& name : ended) EXPECT_GE(words[name], 1) << name;
  for (const std::string& name : ended) {
    SyntheticMap again = DriftingMap();
    EXPECT_THROW(RefineMap(options, parts.parts(), again.map,
                           [&](const RefineProgress& progress) {
                             if (progress.processor == name && !progress.ended) Fail("enough");
                           }),
                 Error)
        << name;
  }
}

TEST(Refine, RepeatsBitByBit) {
  SyntheticMap a = DriftingMap(), b = DriftingMap();
  TestParts parts(a.map);
  RefineMap({}, parts.parts(), a.map);
  RefineMap({}, parts.parts(), b.map);
  ASSERT_EQ(a.map.landmarks.size(), b.map.landmarks.size());
  for (const auto& [id, keyframe] : a.map.keyframes) {
    EXPECT_EQ(keyframe.world_from_cam.translation,
              b.map.keyframes.at(id).world_from_cam.translation);
    EXPECT_EQ(keyframe.landmarks, b.map.keyframes.at(id).landmarks);
  }
}

TEST(Refine, ASecondTimeFindsNothingNewAndMakesItNoWorse) {
  SyntheticMap made = DriftingMap();
  TestParts parts(made.map);
  RefineMap({}, parts.parts(), made.map);
  const double once = KeyframeError(made.map, made.true_world_from_cam);
  const RefineResult again = RefineMap({}, parts.parts(), made.map);
  EXPECT_LT(KeyframeError(made.map, made.true_world_from_cam), once + 0.005);
  EXPECT_LE(again.loops.size(), 3u);
}

class Shift : public MapProcessor {
 public:
  void Process(Map& map, RefineContext& context) override {
    for (auto& [id, landmark] : map.landmarks) landmark.point_in_world.x() += 1;
    context.report["shifted"] = map.landmarks.size();
  }
};

TEST(Refine, RunsAProcessorThatAUserAdds) {
  RegisterMapProcessor("test_shift", [] { return std::make_unique<Shift>(); });
  SyntheticMap made = DriftingMap();
  const Eigen::Vector3d before = made.map.landmarks.at(7).point_in_world;
  RefineOptions options;
  options.processors = "test_shift";
  const RefineResult result = RefineMap(options, {}, made.map);
  EXPECT_EQ(result.report["steps"][0]["shifted"], made.map.landmarks.size());
  EXPECT_EQ(made.map.landmarks.at(7).point_in_world, before + Eigen::Vector3d::UnitX());
}

TEST(Refine, AnUnknownProcessorIsNamedBeforeAnythingIsDone) {
  SyntheticMap made = DriftingMap();
  RefineOptions options;
  options.processors = "loop_closure, loop_clousure";
  try {
    RefineMap(options, {}, made.map);
    FAIL();
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("loop_clousure"), std::string::npos) << error.what();
  }
}

}  // namespace
}  // namespace airslam
