// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/report.h"

#include <gtest/gtest.h>

#include "airslam/geometry/so3.h"
#include "airslam/sensor/temporary_folder.h"

namespace airslam {
namespace {

const Rigid3 kBodyFromLeft(ExpSO3({0.1, 0.2, 0.3}), {0.05, -0.02, 0.01});

// A frame of a component, 0.1 m further along x than its keyframe; component < 0: without a pose.
FrameRecord Frame(int index, int component, KeyframeId reference) {
  FrameRecord record;
  record.timestamp_ns = 1000 + index;
  record.component = component;
  record.reference = reference;
  record.state = component < 0 ? FrameState::kLost : FrameState::kTracked;
  record.reference_from_cam.translation.x() = 0.1;
  record.online_world_from_cam.translation.y() = 5;
  return record;
}

// Frames 0 to 6: component 0, lost, skipped, component 1 three times, lost.
PipelineResult Example() {
  PipelineResult result;
  result.map.calibration.body_from_left = kBodyFromLeft;
  for (KeyframeId id : {0, 1}) {
    Keyframe keyframe;
    keyframe.id = id;
    keyframe.component = id;
    keyframe.timestamp_ns = id == 0 ? 1000 : 1003;
    keyframe.world_from_cam.translation.z() = 10 * (id + 1);
    result.map.keyframes[id] = keyframe;
  }
  const int components[] = {0, -1, -1, 1, 1, 1, -1};
  for (int i = 0; i < 7; ++i) result.records.push_back(Frame(i, components[i], components[i]));
  result.records[2].state = FrameState::kSkipped;
  result.records[4].used_matcher = true;
  return result;
}

TEST(Report, TheLargestComponentHasTheMostFrames) {
  PipelineResult result = Example();
  EXPECT_EQ(LargestComponent(result), 1);
  result.records.resize(4);  // one frame each: the earlier
  EXPECT_EQ(LargestComponent(result), 0);
  result.records = {Frame(0, -1, -1)};
  EXPECT_EQ(LargestComponent(result), -1);
  EXPECT_TRUE(FinalTrajectory(result, -1).empty());
  EXPECT_TRUE(OnlineTrajectory(result, -1).empty());
}

TEST(Report, TrajectoriesAreOfTheBodyAndFollowTheKeyframe) {
  const PipelineResult result = Example();
  const Trajectory final = FinalTrajectory(result, 1), online = OnlineTrajectory(result, 1);
  ASSERT_EQ(final.size(), 3u);
  ASSERT_EQ(online.size(), 3u);
  EXPECT_EQ(final[0].timestamp_ns, 1003);
  EXPECT_EQ(final[2].timestamp_ns, 1005);
  const auto camera = [](const StampedPose& pose) {
    return (pose.world_from_body * kBodyFromLeft).translation;
  };
  EXPECT_LT((camera(final[0]) - Eigen::Vector3d(0.1, 0, 20)).norm(), 1e-12);
  EXPECT_LT((camera(online[0]) - Eigen::Vector3d(0, 5, 0)).norm(), 1e-12);
  const Trajectory keyframes = KeyframeTrajectory(result, 1);
  ASSERT_EQ(keyframes.size(), 1u);
  EXPECT_LT((camera(keyframes[0]) - Eigen::Vector3d(0, 0, 20)).norm(), 1e-12);
}

TEST(Report, CountsFramesAndNamesLostIntervals) {
  StageTimes times;
  times.Record("track", 2);
  times.Record("track", 4);
  const nlohmann::json report =
      MakeReport(Example(), times, {"data", "pack", "a: 1\n", 3.5, 9, "SIGTERM"});
  EXPECT_EQ(report["frames"], 7);
  EXPECT_EQ(report["frames_in_sequence"], 9);
  EXPECT_EQ(report["stopped_by"], "SIGTERM");
  EXPECT_EQ(report["frames_with_pose"], 4);
  EXPECT_EQ(report["frames_in_trajectory"], 3);
  EXPECT_EQ(report["frames_skipped"], 1);
  EXPECT_EQ(report["frames_that_needed_the_matcher"], 1);
  EXPECT_EQ(report["components"], 2);
  EXPECT_DOUBLE_EQ(report["frames_per_second"], 2.0);
  EXPECT_DOUBLE_EQ(report["stages"]["track"]["mean_ms"], 3.0);
  const nlohmann::json intervals = {{{"from_ns", 1001}, {"to_ns", 1002}, {"frames", 2}},
                                    {{"from_ns", 1006}, {"to_ns", 1006}, {"frames", 1}}};
  EXPECT_EQ(report["lost_intervals"], intervals);
  EXPECT_EQ(report["frame_states"][2]["state"], "skipped");
  EXPECT_EQ(report["frame_states"][6]["state"], "lost");
}

TEST(Report, SaysWhenAFileCannotBeWritten) {
  const TemporaryFolder folder;
  const std::string text = ErrorOf(
      [&] { WriteRunOutputs(folder.path() / "nowhere", Example(), StageTimes(), RunInfo()); });
  EXPECT_NE(text.find("nowhere"), std::string::npos) << text;
}

}  // namespace
}  // namespace airslam
