// SPDX-License-Identifier: BSD-3-Clause
//
// The whole odometry with an IMU on the synthetic world.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <filesystem>
#include <limits>
#include <numbers>

#include "airslam/geometry/alignment.h"
#include "airslam/odometry/pipeline.h"
#include "airslam/odometry/report.h"
#include "airslam/sensor/temporary_folder.h"
#include "airslam/testing/synthetic_detector.h"
#include "airslam/testing/synthetic_sequence.h"

namespace airslam {
namespace {

constexpr int kFrames = 70;  // 7 s
const Eigen::Vector3d kGyroscopeBias(0.01, -0.02, 0.03);
const Eigen::Vector3d kAccelerometerBias(0.1, -0.15, 0.05);

SyntheticSequenceOptions Options(int frames) {
  SyntheticSequenceOptions options;
  options.frames = frames;
  options.imu.gyroscope_bias = kGyroscopeBias;
  options.imu.accelerometer_bias = kAccelerometerBias;
  return options;
}

// The synthetic sequence, whose images are rendered once for all tests.
class Rendered {
 public:
  static const Rendered& Get() {
    static const Rendered rendered;
    return rendered;
  }
  const SyntheticSequence& sequence() const { return sequence_; }
  // Shares its pixels: they must not be changed.
  const StereoPair& pair(int index) const { return pairs_[index]; }

 private:
  Rendered() : sequence_(Options(kFrames)) {
    for (int i = 0; i < kFrames; ++i) pairs_.push_back(sequence_.Read(i));
  }
  SyntheticSequence sequence_;
  std::vector<StereoPair> pairs_;
};

// It, with frames that are black, and with other readings.
class TestSequence : public Sequence {
 public:
  TestSequence() : rig_(source().rig()), imu_(source().imu()) {}

  static const SyntheticSequence& source() { return Rendered::Get().sequence(); }
  std::string name() const override { return "test"; }
  const StereoRig& rig() const override { return rig_; }
  int size() const override { return kFrames; }
  std::int64_t timestamp_ns(int index) const override { return source().timestamp_ns(index); }
  const std::vector<ImuSample>& imu() const override { return imu_; }
  const std::vector<std::string>& warnings() const override { return source().warnings(); }
  StereoPair Read(int index) const override {
    StereoPair pair = Rendered::Get().pair(index);
    if (index >= black_from && index < black_to) {
      pair.left = cv::Mat(pair.left.size(), CV_8UC1, cv::Scalar(0));
      pair.right = pair.left;
    }
    return pair;
  }

  StereoRig& rig() { return rig_; }
  std::vector<ImuSample>& imu() { return imu_; }
  int black_from = 0, black_to = 0;

 private:
  StereoRig rig_;
  std::vector<ImuSample> imu_;
};

PipelineResult RunOn(const Sequence& sequence, const OdometryOptions& options = {},
                     MapRecorder* recorder = nullptr) {
  cv::setNumThreads(1);  // as the program does; ThreadSanitizer cannot see into OpenCV's threads
  const StereoRectifier rectifier(sequence.rig());
  SyntheticDetector detector, line_detector;
  SyntheticMatcher matcher;
  StageTimes times;
  return RunPipeline(sequence, rectifier, options, {detector, line_detector, matcher}, recorder, {},
                     times);
}

int Count(const PipelineResult& result, FrameState state) {
  return static_cast<int>(std::count_if(result.records.begin(), result.records.end(),
                                        [&](const FrameRecord& r) { return r.state == state; }));
}

// RMSE of the positions of all frames after SE(3) alignment, metres.
double Ate(const PipelineResult& result) {
  const Trajectory truth = TestSequence::source().ground_truth();
  const Trajectory estimate = FinalTrajectory(result, 0);
  if (estimate.size() != truth.size()) return std::numeric_limits<double>::infinity();
  std::vector<Eigen::Vector3d> from, to;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    from.push_back(estimate[i].world_from_body.translation);
    to.push_back(truth[i].world_from_body.translation);
  }
  const Similarity3 align = AlignPoints(from, to, false).value();
  double squares = 0;
  for (std::size_t i = 0; i < to.size(); ++i) squares += (align * from[i] - to[i]).squaredNorm();
  return std::sqrt(squares / static_cast<double>(to.size()));
}

// Largest angle between the estimate's up and the truth's, seen from the body, degrees.
double WorstTilt(const Trajectory& estimate) {
  const Trajectory truth = TestSequence::source().ground_truth();
  double worst = 0;
  for (const StampedPose& pose : estimate) {
    const auto same = std::find_if(truth.begin(), truth.end(), [&](const StampedPose& p) {
      return p.timestamp_ns == pose.timestamp_ns;
    });
    const Eigen::Vector3d up = pose.world_from_body.rotation.conjugate() * Eigen::Vector3d::UnitZ();
    const Eigen::Vector3d true_up =
        same->world_from_body.rotation.conjugate() * Eigen::Vector3d::UnitZ();
    worst = std::max(worst, std::acos(std::min(1.0, up.dot(true_up))));
  }
  return worst * 180 / std::numbers::pi;
}

void ExpectSamePoses(const PipelineResult& a, const PipelineResult& b) {
  for (const auto& trajectory : {FinalTrajectory, OnlineTrajectory}) {
    const Trajectory first = trajectory(a, 0), second = trajectory(b, 0);
    ASSERT_EQ(first.size(), second.size());
    for (std::size_t i = 0; i < first.size(); ++i) {
      EXPECT_EQ(first[i].world_from_body.ToMatrix(), second[i].world_from_body.ToMatrix()) << i;
    }
  }
}

TEST(InertialPipeline, FindsGravityBiasesAndVelocities) {
  const PipelineResult result = RunOn(TestSequence());
  EXPECT_EQ(result.inertial.state, "used");
  ASSERT_EQ(result.inertial.starts.size(), 1u);
  EXPECT_LT(result.inertial.starts[0].seconds, 6);
  EXPECT_EQ(Count(result, FrameState::kTracked), kFrames - 1);
  for (const auto& trajectory : {FinalTrajectory, OnlineTrajectory, KeyframeTrajectory}) {
    EXPECT_LT(WorstTilt(trajectory(result, 0)), 0.5);
  }
  EXPECT_LT((result.inertial.final_bias.gyroscope - kGyroscopeBias).norm(), 0.005);
  EXPECT_LT((result.inertial.final_bias.accelerometer - kAccelerometerBias).norm(), 0.1);
  const Trajectory truth = TestSequence::source().ground_truth();
  int states = 0;
  for (const auto& [id, keyframe] : result.map.keyframes) {
    if (!keyframe.has_inertial_state) continue;
    ++states;
    const BodyState body = TestSequence::source().trajectory().At(keyframe.timestamp_ns);
    const Eigen::Quaterniond world_from_cam = keyframe.world_from_cam.rotation;
    const Eigen::Vector3d in_body = result.map.calibration.body_from_left.rotation *
                                    world_from_cam.conjugate() * keyframe.velocity_in_world;
    EXPECT_LT((in_body - body.world_from_body.rotation.conjugate() * body.velocity_in_world).norm(),
              0.05)
        << id;
  }
  EXPECT_EQ(states, static_cast<int>(result.map.keyframes.size()));
}

TEST(InertialPipeline, IsNotWorseThanStereo) {
  OdometryOptions stereo;
  stereo.inertial.enabled = false;
  EXPECT_LT(Ate(RunOn(TestSequence())), 1.05 * Ate(RunOn(TestSequence(), stereo)));
}

TEST(InertialPipeline, TheRecordedMapIsTheMapInMemoryAndRepeats) {
  TestSequence sequence;
  sequence.black_from = 55;
  sequence.black_to = 60;
  const TemporaryFolder folder;
  const StereoRectifier rectifier(sequence.rig());
  std::vector<PipelineResult> results;
  for (const char* name : {"a.db", "b.db"}) {
    StageTimes times;
    MapRecorder recorder(folder.path() / name, MakeMapCalibration(sequence.rig(), rectifier),
                         "stand-in", std::string(64, '0'), times);
    results.push_back(RunOn(sequence, {}, &recorder));
  }
  ASSERT_EQ(results[0].inertial.state, "used");
  ExpectSamePoses(results[0], results[1]);
  EXPECT_EQ(MapDigest(folder.path() / "a.db"), MapDigest(folder.path() / "b.db"));
  const Map map = ReadMap(folder.path() / "a.db");
  ASSERT_EQ(map.keyframes.size(), results[0].map.keyframes.size());
  for (const auto& [id, keyframe] : results[0].map.keyframes) {
    const Keyframe& read = map.keyframes.at(id);
    EXPECT_EQ(read.world_from_cam.ToMatrix(), keyframe.world_from_cam.ToMatrix());
    EXPECT_EQ(read.has_inertial_state, keyframe.has_inertial_state);
    EXPECT_EQ(read.velocity_in_world, keyframe.velocity_in_world);
    EXPECT_EQ(read.accelerometer_bias, keyframe.accelerometer_bias);
  }
  for (const auto& [id, landmark] : results[0].map.landmarks) {
    EXPECT_EQ(map.landmarks.at(id).point_in_world, landmark.point_in_world);
  }
}

TEST(InertialPipeline, CarriesTheFramesOfABlackout) {
  TestSequence sequence;
  sequence.black_from = 50;
  sequence.black_to = 60;
  const PipelineResult result = RunOn(sequence);
  EXPECT_EQ(Count(result, FrameState::kInertial), 10);
  EXPECT_EQ(Count(result, FrameState::kLost), 0);
  EXPECT_EQ(result.records[60].state, FrameState::kTracked);
  EXPECT_EQ(FinalTrajectory(result, 0).size(), static_cast<std::size_t>(kFrames));
  EXPECT_LT(Ate(result), 0.03);
  const Trajectory truth = TestSequence::source().ground_truth();
  // From the last frame that was seen to the last one that was not.
  const auto moved = [](const Trajectory& t) {
    return (t[49].world_from_body.Inverse() * t[59].world_from_body).translation;
  };
  EXPECT_GT(moved(truth).norm(), 0.5);
  EXPECT_LT((moved(OnlineTrajectory(result, 0)) - moved(truth)).norm(), 0.1);
  EXPECT_LT((moved(FinalTrajectory(result, 0)) - moved(truth)).norm(), 0.05);
}

TEST(InertialPipeline, ABlackoutThatLastsTooLongIsLost) {
  TestSequence sequence;
  sequence.black_from = 50;
  sequence.black_to = 60;
  OdometryOptions options;
  options.inertial.max_blackout = 0.45;
  const PipelineResult result = RunOn(sequence, options);
  EXPECT_EQ(Count(result, FrameState::kInertial), 4);
  EXPECT_EQ(result.records[54].state, FrameState::kLost);
  EXPECT_FALSE(result.records[59].has_pose());
}

// After the dark nothing is in sight that was seen before: the IMU alone ties the new keyframe to
// the old ones.
TEST(InertialPipeline, GoesOnWhereNothingIsKnownAfterABlackout) {
  class Elsewhere : public TestSequence {
   public:
    StereoPair Read(int index) const override {
      StereoPair pair = TestSequence::Read(index);
      if (index < black_to) return pair;
      StereoPair turned = pair;  // as no keyframe has seen it
      turned.left = turned.right = cv::Mat();
      cv::rotate(pair.right, turned.left, cv::ROTATE_180);
      cv::rotate(pair.left, turned.right, cv::ROTATE_180);
      return turned;
    }
  } sequence;
  sequence.black_from = 50;
  sequence.black_to = 55;
  const PipelineResult result = RunOn(sequence);
  EXPECT_EQ(result.records[50].state, FrameState::kInertial);
  EXPECT_EQ(result.records[54].state, FrameState::kInertial);
  const auto anew = std::find_if(
      result.records.begin() + 55, result.records.end(),
      [](const FrameRecord& r) { return r.state == FrameState::kInertial && r.is_keyframe; });
  ASSERT_NE(anew, result.records.end());
  EXPECT_EQ(anew->component, 0);
  EXPECT_LT(anew - result.records.begin(), 62);
}

TEST(InertialPipeline, AnImuGapLeavesVisionAlone) {
  TestSequence sequence;
  const std::int64_t from = sequence.timestamp_ns(50), to = sequence.timestamp_ns(55);
  std::erase_if(sequence.imu(), [&](const ImuSample& sample) {
    return sample.timestamp_ns > from && sample.timestamp_ns < to;
  });
  const PipelineResult result = RunOn(sequence);
  EXPECT_EQ(Count(result, FrameState::kTracked), kFrames - 1);
  ASSERT_EQ(result.inertial.gaps.size(), 1u);
  EXPECT_LE(result.inertial.gaps[0].begin_ns, from);
  EXPECT_GE(result.inertial.gaps[0].end_ns, to);
  EXPECT_LT(Ate(result), 0.03);
  EXPECT_LT(WorstTilt(FinalTrajectory(result, 0)), 0.5);
}

TEST(InertialPipeline, SaturatedReadingsAreNotUsed) {
  TestSequence sequence;
  for (ImuSample& sample : sequence.imu()) {
    if (sample.timestamp_ns < sequence.timestamp_ns(50)) continue;
    if (sample.timestamp_ns > sequence.timestamp_ns(51)) continue;
    sample.acceleration.x() = 160;  // the end of a scale of 16 g
  }
  const PipelineResult result = RunOn(sequence);
  EXPECT_EQ(Count(result, FrameState::kTracked), kFrames - 1);
  EXPECT_EQ(result.inertial.gaps.size(), 1u);
  EXPECT_LT(Ate(result), 0.03);
}

TEST(InertialPipeline, DuplicateAndReversedReadingsAreDropped) {
  TestSequence sequence;
  std::vector<ImuSample>& imu = sequence.imu();
  ImuSample late = imu[100];
  late.acceleration.setConstant(50);
  imu.insert(imu.begin() + 200, {late, imu[199]});
  const PipelineResult result = RunOn(sequence);
  EXPECT_EQ(result.inertial.dropped, 2);
  EXPECT_EQ(result.inertial.state, "used");
  ExpectSamePoses(result, RunOn(TestSequence()));
}

TEST(InertialPipeline, WithoutReadingsOrSwitchedOffItIsStereo) {
  TestSequence no_readings, no_imu;
  no_readings.imu().clear();
  no_imu.rig().imu.reset();
  OdometryOptions off;
  off.inertial.enabled = false;
  const PipelineResult stereo = RunOn(TestSequence(), off);
  EXPECT_EQ(stereo.inertial.state, "off");
  const PipelineResult without = RunOn(no_readings);
  EXPECT_EQ(without.inertial.state, "no readings");
  ExpectSamePoses(stereo, without);
  const PipelineResult uncalibrated = RunOn(no_imu);
  EXPECT_EQ(uncalibrated.inertial.state, "no calibration");
  ExpectSamePoses(stereo, uncalibrated);
}

TEST(InertialPipeline, AWrongTimeOffsetIsFound) {
  for (const double offset : {0.02, -0.02}) {
    TestSequence sequence;
    for (ImuSample& sample : sequence.imu()) sample.timestamp_ns += std::llround(1e9 * offset);
    const PipelineResult result = RunOn(sequence);
    EXPECT_EQ(result.inertial.state, "used");
    EXPECT_NEAR(result.inertial.time_offset, offset, 0.001);
    EXPECT_LT(WorstTilt(FinalTrajectory(result, 0)), 0.5);
  }
}

TEST(InertialPipeline, ACalibratedTimeOffsetIsUsed) {
  TestSequence sequence;
  for (ImuSample& sample : sequence.imu()) sample.timestamp_ns += 20'000'000;
  sequence.rig().imu_time_offset = 0.02;
  const PipelineResult result = RunOn(sequence);
  EXPECT_EQ(result.inertial.time_offset, 0.02);
  ExpectSamePoses(result, RunOn(TestSequence()));
}

// Readings of another motion: it says so, and goes on as stereo.
TEST(InertialPipeline, ReadingsThatDoNotFitAreRefused) {
  TestSequence sequence;
  for (ImuSample& sample : sequence.imu()) {
    std::swap(sample.acceleration.x(), sample.acceleration.y());
    std::swap(sample.angular_velocity.x(), sample.angular_velocity.z());
  }
  OdometryOptions off;
  off.inertial.enabled = false;
  const PipelineResult result = RunOn(sequence);
  EXPECT_NE(result.inertial.state, "used");
  EXPECT_FALSE(result.inertial.reason.empty());
  ExpectSamePoses(result, RunOn(TestSequence(), off));
}

}  // namespace
}  // namespace airslam
