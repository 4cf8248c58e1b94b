// SPDX-License-Identifier: BSD-3-Clause
//
// Frames and readings added one by one give what the recorded sequence gives, bit for bit.
#include <gtest/gtest.h>

#include <cstdint>
#include <functional>
#include <map>
#include <opencv2/core/utility.hpp>
#include <stdexcept>
#include <thread>

#include "airslam/common/error.h"
#include "airslam/dataset/live_sequence.h"
#include "airslam/odometry/pipeline.h"
#include "airslam/odometry/report.h"
#include "airslam/testing/synthetic_detector.h"
#include "airslam/testing/synthetic_sequence.h"

namespace airslam {
namespace {

constexpr int kFrames = 50;  // 5 s

// A recorded sequence, another time offset in its calibration than in its readings.
class Recorded : public Sequence {
 public:
  explicit Recorded(double offset_error) : rig_(source().rig()) {
    rig_.imu_time_offset += offset_error;
  }
  static const SyntheticSequence& source() {
    static const SyntheticSequence sequence([] {
      SyntheticSequenceOptions options;
      options.frames = kFrames;
      options.imu.gyroscope_bias = {0.01, -0.02, 0.03};
      return options;
    }());
    return sequence;
  }
  std::string name() const override { return "recorded"; }
  const StereoRig& rig() const override { return rig_; }
  int size() const override { return kFrames; }
  std::int64_t timestamp_ns(int index) const override { return source().timestamp_ns(index); }
  const std::vector<ImuSample>& imu() const override { return source().imu(); }
  const std::vector<std::string>& warnings() const override { return source().warnings(); }
  StereoPair Read(int index) const override {
    static std::vector<StereoPair> pairs(kFrames);  // rendered once; one thread reads
    if (pairs[index].left.empty()) pairs[index] = source().Read(index);
    return pairs[index];
  }

 private:
  StereoRig rig_;
};

PipelineResult RunOn(const Sequence& sequence, const FrameObserver& observer = {}) {
  cv::setNumThreads(1);
  const StereoRectifier rectifier(sequence.rig());
  SyntheticDetector detector({.lines = true}), line_detector({.lines = true});
  SyntheticMatcher matcher;
  StageTimes times;
  return RunPipeline(sequence, rectifier, {}, {detector, line_detector, matcher}, nullptr, observer,
                     times);
}

// Adds everything; `lead`: how many seconds the readings come before the frames.
void Feed(const Recorded& recorded, double lead, LiveSequence& live) {
  const std::vector<ImuSample>& imu = recorded.imu();
  std::size_t next = 0;
  for (int i = 0; i < recorded.size(); ++i) {
    const StereoPair pair = recorded.Read(i);
    const std::int64_t until = pair.timestamp_ns + static_cast<std::int64_t>(1e9 * lead);
    for (; next < imu.size() && imu[next].timestamp_ns < until; ++next) live.AddImu(imu[next]);
    live.AddFrame(pair);
  }
  for (; next < imu.size(); ++next) live.AddImu(imu[next]);
  live.End();
}

PipelineResult RunLive(const Recorded& recorded, double lead) {
  LiveSequence live(recorded.rig(), true);
  std::thread feeder([&] { Feed(recorded, lead, live); });
  PipelineResult result = RunOn(live);
  feeder.join();
  return result;
}

void ExpectSame(const PipelineResult& a, const PipelineResult& b) {
  ASSERT_EQ(a.records.size(), b.records.size());
  for (std::size_t i = 0; i < a.records.size(); ++i) {
    EXPECT_EQ(a.records[i].state, b.records[i].state) << i;
    EXPECT_EQ(a.records[i].online_world_from_cam.ToMatrix(),
              b.records[i].online_world_from_cam.ToMatrix())
        << i;
    EXPECT_EQ(a.records[i].reference_from_cam.ToMatrix(),
              b.records[i].reference_from_cam.ToMatrix())
        << i;
  }
  ASSERT_EQ(a.map.keyframes.size(), b.map.keyframes.size());
  for (const auto& [id, keyframe] : a.map.keyframes) {
    const Keyframe& other = b.map.keyframes.at(id);
    EXPECT_EQ(keyframe.world_from_cam.ToMatrix(), other.world_from_cam.ToMatrix()) << id;
    EXPECT_EQ(keyframe.velocity_in_world, other.velocity_in_world) << id;
    EXPECT_EQ(keyframe.landmarks, other.landmarks) << id;
    EXPECT_EQ(keyframe.line_landmarks, other.line_landmarks) << id;
    ASSERT_EQ(keyframe.imu_samples.size(), other.imu_samples.size()) << id;
  }
  ASSERT_EQ(a.map.landmarks.size(), b.map.landmarks.size());
  for (const auto& [id, landmark] : a.map.landmarks) {
    EXPECT_EQ(landmark.point_in_world, b.map.landmarks.at(id).point_in_world) << id;
  }
  ASSERT_EQ(a.map.line_landmarks.size(), b.map.line_landmarks.size());
  EXPECT_EQ(a.inertial.state, b.inertial.state);
  EXPECT_EQ(a.inertial.time_offset, b.inertial.time_offset);
  EXPECT_EQ(a.inertial.readings, b.inertial.readings);
}

TEST(LivePipeline, GivesWhatTheRecordedSequenceGives) {
  const Recorded recorded(0);
  const PipelineResult expected = RunOn(recorded);
  ASSERT_EQ(expected.inertial.state, "used");
  ASSERT_FALSE(expected.map.line_landmarks.empty());
  for (double lead : {-0.05, 0.0, 0.3}) {
    SCOPED_TRACE(lead);
    ExpectSame(expected, RunLive(recorded, lead));
  }
}

TEST(LivePipeline, WaitsForTheReadingsThatAWrongTimeOffsetNeeds) {
  const Recorded recorded(0.02);
  const PipelineResult expected = RunOn(recorded);
  ASSERT_NE(expected.inertial.time_offset, expected.inertial.calibrated_time_offset);
  ExpectSame(expected, RunLive(recorded, 0));
}

TEST(LivePipeline, AnImuThatEndsLeavesStereo) {
  const Recorded recorded(0);
  LiveSequence live(recorded.rig(), true);
  live.EndImu();
  std::thread feeder([&] {
    for (int i = 0; i < 10; ++i) live.AddFrame(recorded.Read(i));
    live.End();
  });
  const PipelineResult result = RunOn(live);
  feeder.join();
  EXPECT_EQ(result.records.size(), 10u);
  EXPECT_EQ(result.inertial.state, "no readings");
  EXPECT_EQ(result.records.back().state, FrameState::kTracked);
}

TEST(LivePipeline, TheObserverIsToldWhatHoldsAFrame) {
  const Recorded recorded(0);
  const StereoRectifier rectifier(recorded.rig());
  const Pinhole camera = rectifier.stereo().camera;
  std::map<LandmarkId, Eigen::Vector3d> points;  // as the keyframes saw them first
  int keyframes = 0, with_lines = 0, shown = 0, near = 0;
  std::vector<double> gravity;
  const PipelineResult result = RunOn(recorded, [&](const FrameObservation& seen) {
    ASSERT_EQ(static_cast<int>(seen.points.size()), seen.record.tracked_points);
    ASSERT_EQ(seen.keyframe != nullptr, seen.record.is_keyframe);
    const Rigid3 cam_from_world = seen.record.online_world_from_cam.Inverse();
    for (const TrackedPoint& point : seen.points) {
      if (!points.contains(point.landmark)) continue;
      const Eigen::Vector3d in_cam = cam_from_world * points.at(point.landmark);
      near += (camera.Project(in_cam) - point.pixel).norm() < 3;
      ++shown;
    }
    if (seen.inertial) {
      gravity.push_back(seen.inertial->gravity_in_world.norm());
      EXPECT_LT((seen.inertial->bias.gyroscope - Eigen::Vector3d(0.01, -0.02, 0.03)).norm(), 0.01);
    }
    if (seen.keyframe == nullptr) return;
    ++keyframes;
    if (seen.lined != nullptr) {  // the keyframe before it
      with_lines += !seen.lined->lines.empty();
      EXPECT_EQ(seen.lined->id, seen.keyframe->id - 1);
    }
    EXPECT_EQ(seen.keyframe->timestamp_ns, seen.record.timestamp_ns);
    for (std::size_t i = 0; i < seen.keyframe->landmarks.size(); ++i) {
      const float right = seen.keyframe->right_x[i];
      if (seen.keyframe->landmarks[i] == kNoLandmark || right < 0) continue;
      const Keypoint& left = seen.keyframe->keypoints[i];
      const double depth = camera.fx * rectifier.stereo().baseline / (left.x - right);
      const Eigen::Vector3d ray((left.x - camera.cx) / camera.fx, (left.y - camera.cy) / camera.fy,
                                1);
      points.emplace(seen.keyframe->landmarks[i], seen.keyframe->world_from_cam * (depth * ray));
    }
  });
  EXPECT_EQ(keyframes, static_cast<int>(result.map.keyframes.size()));
  EXPECT_EQ(with_lines, keyframes - 1);
  EXPECT_GT(shown, 20 * kFrames);
  EXPECT_GT(near, 0.95 * shown);
  ASSERT_GT(gravity.size(), 10u);  // from the initialisation on
  EXPECT_LT(gravity.size(), static_cast<std::size_t>(kFrames));
  EXPECT_NEAR(gravity.back(), 9.81, 0.02);
}

TEST(LivePipeline, WhatEndsTheRunEndsTheWaitForFramesToo) {
  const Recorded recorded(0);
  LiveSequence live(recorded.rig(), false);
  std::thread feeder([&] {
    try {
      for (int i = 0; i < kFrames; ++i) live.AddFrame(recorded.Read(i));
    } catch (const Error&) {  // after the end
    }
  });
  EXPECT_THROW(RunOn(live,
                     [](const FrameObservation& seen) {
                       if (seen.prepared.index == 3) throw std::logic_error("enough");
                     }),
               std::logic_error);
  feeder.join();
  EXPECT_TRUE(live.abandoned());
}

}  // namespace
}  // namespace airslam
