// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/pipeline.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <filesystem>
#include <functional>
#include <map>
#include <opencv2/core/utility.hpp>
#include <set>
#include <stdexcept>

#include "airslam/common/error.h"
#include "airslam/odometry/report.h"
#include "airslam/testing/synthetic_detector.h"
#include "airslam/testing/synthetic_sequence.h"

namespace airslam {
namespace {

// A synthetic sequence some of whose images are spoilt.
class SpoiltSequence : public Sequence {
 public:
  SpoiltSequence(const SyntheticSequence& source, std::function<void(int, StereoPair&)> spoil)
      : source_(source), spoil_(std::move(spoil)) {}
  std::string name() const override { return "spoilt"; }
  const StereoRig& rig() const override { return source_.rig(); }
  int size() const override { return source_.size(); }
  std::int64_t timestamp_ns(int index) const override { return source_.timestamp_ns(index); }
  const std::vector<ImuSample>& imu() const override { return source_.imu(); }
  const std::vector<std::string>& warnings() const override { return source_.warnings(); }
  StereoPair Read(int index) const override {
    StereoPair pair = source_.Read(index);
    spoil_(index, pair);
    return pair;
  }

 private:
  const SyntheticSequence& source_;
  std::function<void(int, StereoPair&)> spoil_;
};

class BrokenDetector : public FeatureDetector {
 public:
  Detections Detect(const cv::Mat&, const cv::Mat&, const DetectionRequest&) override {
    throw std::runtime_error("the detector broke");
  }
  int descriptor_size() const override { return 64; }
};

PipelineResult RunOn(const Sequence& sequence, MapRecorder* recorder = nullptr,
                     bool detector_finds_lines = false, const OdometryOptions& options = {}) {
  cv::setNumThreads(1);  // as the program does; ThreadSanitizer cannot see into OpenCV's threads
  const StereoRectifier rectifier(sequence.rig());
  const SyntheticDetector::Options detection{.lines = detector_finds_lines};
  SyntheticDetector detector(detection), line_detector(detection);
  SyntheticMatcher matcher;
  StageTimes times;
  return RunPipeline(sequence, rectifier, options, {detector, line_detector, matcher}, recorder, {},
                     times);
}

SyntheticSequenceOptions Options(int frames) {
  SyntheticSequenceOptions options;
  options.frames = frames;
  return options;
}

// Root mean square of position errors after moving the first pose onto the truth's.
double PositionError(const Trajectory& estimate, const Trajectory& truth) {
  const Rigid3 align = truth[0].world_from_body * estimate[0].world_from_body.Inverse();
  double squares = 0;
  for (std::size_t i = 0; i < estimate.size(); ++i) {
    squares +=
        (align * estimate[i].world_from_body.translation - truth[i].world_from_body.translation)
            .squaredNorm();
  }
  return std::sqrt(squares / static_cast<double>(estimate.size()));
}

TEST(Pipeline, TracksEveryFrameOfTheSyntheticWorld) {
  const SyntheticSequence sequence(Options(40));
  const PipelineResult result = RunOn(sequence);
  ASSERT_EQ(result.records.size(), 40u);
  EXPECT_EQ(result.records[0].state, FrameState::kInitialized);
  for (std::size_t i = 1; i < 40; ++i) {
    EXPECT_EQ(result.records[i].state, FrameState::kTracked) << i;
  }
  EXPECT_LT(PositionError(FinalTrajectory(result, 0), sequence.ground_truth()), 0.05);
  EXPECT_GT(result.map.keyframes.size(), 2u);
  EXPECT_LT(result.map.keyframes.size(), 40u);
}

TEST(Pipeline, RepeatsBitByBit) {
  const SyntheticSequence sequence(Options(25));
  const std::filesystem::path folder = std::filesystem::path(::testing::TempDir()) /
                                       ("airslam_pipeline_repeats_" + std::to_string(getpid()));
  std::filesystem::remove_all(folder);
  std::filesystem::create_directories(folder);
  std::vector<std::string> digests;
  std::vector<Trajectory> online, final;
  for (const char* name : {"a.db", "b.db"}) {
    const StereoRectifier rectifier(sequence.rig());
    StageTimes times;
    MapRecorder recorder(folder / name, MakeMapCalibration(sequence.rig(), rectifier), "stand-in",
                         std::string(64, '0'), times);
    const PipelineResult result = RunOn(sequence, &recorder);
    digests.push_back(MapDigest(folder / name));
    online.push_back(OnlineTrajectory(result, 0));
    final.push_back(FinalTrajectory(result, 0));
  }
  EXPECT_EQ(digests[0], digests[1]);
  ASSERT_EQ(final[0].size(), final[1].size());
  for (std::size_t i = 0; i < final[0].size(); ++i) {
    EXPECT_EQ(final[0][i].world_from_body.ToMatrix(), final[1][i].world_from_body.ToMatrix());
    EXPECT_EQ(online[0][i].world_from_body.ToMatrix(), online[1][i].world_from_body.ToMatrix());
  }
  std::filesystem::remove_all(folder);
}

TEST(Pipeline, TheRecordedMapIsTheMapInMemory) {
  const SyntheticSequence sequence(Options(25));
  const std::filesystem::path file =
      std::filesystem::path(::testing::TempDir()) /
      ("airslam_pipeline_recorded_" + std::to_string(getpid()) + ".db");
  std::filesystem::remove(file);
  const StereoRectifier rectifier(sequence.rig());
  StageTimes times;
  MapRecorder recorder(file, MakeMapCalibration(sequence.rig(), rectifier), "stand-in",
                       std::string(64, '0'), times);
  const PipelineResult result = RunOn(sequence, &recorder);
  const Map map = ReadMap(file);
  ASSERT_EQ(map.keyframes.size(), result.map.keyframes.size());
  ASSERT_EQ(map.landmarks.size(), result.map.landmarks.size());
  for (const auto& [id, keyframe] : result.map.keyframes) {
    EXPECT_EQ(map.keyframes.at(id).landmarks, keyframe.landmarks);
    EXPECT_EQ(map.keyframes.at(id).world_from_cam.translation, keyframe.world_from_cam.translation);
  }
  for (const auto& [id, landmark] : result.map.landmarks) {
    EXPECT_EQ(map.landmarks.at(id).point_in_world, landmark.point_in_world);
  }
  std::filesystem::remove(file);
}

// How far line landmarks that two keyframes or more see miss what is really there: difference of
// distances from the first of these keyframes to the middle of the line, as shares of the distance.
std::vector<double> LineErrors(const PipelineResult& result, const SyntheticSequence& sequence) {
  std::map<LandmarkId, int> seen;
  for (const auto& [id, keyframe] : result.map.keyframes) {
    for (LandmarkId line : keyframe.line_landmarks) seen[line] += line != kNoLandmark;
  }
  const Rigid3 truth_from_world = sequence.ground_truth()[0].world_from_body *
                                  FinalTrajectory(result, 0)[0].world_from_body.Inverse();
  std::vector<double> errors;
  for (const auto& [id, line] : result.map.line_landmarks) {
    if (seen[id] < 2) continue;
    const Keyframe& first = result.map.keyframes.at(line.first_seen_by);
    const Eigen::Vector3d eye = truth_from_world * first.world_from_cam.translation;
    const Eigen::Vector3d middle =
        truth_from_world * Eigen::Vector3d((line.ends_in_world.start + line.ends_in_world.end) / 2);
    const double distance = (middle - eye).norm();
    const auto hit = sequence.world().Cast(eye, (middle - eye) / distance);
    errors.push_back(std::abs(hit->distance / distance - 1));
  }
  std::sort(errors.begin(), errors.end());
  return errors;
}

TEST(Pipeline, MapsLinesWhereTheyAre) {
  SyntheticSequenceOptions synthetic = Options(60);
  synthetic.rig = EurocLikeRig(560, 364);
  const SyntheticSequence sequence(synthetic);
  const PipelineResult result = RunOn(sequence, nullptr, true);
  EXPECT_LT(PositionError(FinalTrajectory(result, 0), sequence.ground_truth()), 0.05);
  for (const auto& [id, keyframe] : result.map.keyframes) {
    EXPECT_GT(keyframe.lines.size(), 5u);
    ASSERT_EQ(keyframe.line_landmarks.size(), keyframe.lines.size());
    for (LandmarkId line : keyframe.line_landmarks) {
      EXPECT_TRUE(line == kNoLandmark || result.map.line_landmarks.contains(line));
    }
  }
  const std::vector<double> errors = LineErrors(result, sequence);
  ASSERT_GT(errors.size(), 5u);
  EXPECT_LT(errors[errors.size() / 2], 0.02) << errors.size();
  EXPECT_LT(errors[errors.size() * 8 / 10], 0.1) << errors.size();
}

TEST(Pipeline, WithLinesItRepeatsAndWithoutItIsAsIfThereWereNone) {
  const SyntheticSequence sequence(Options(15));
  const std::filesystem::path folder = std::filesystem::path(::testing::TempDir()) /
                                       ("airslam_pipeline_lines_" + std::to_string(getpid()));
  std::filesystem::remove_all(folder);
  std::filesystem::create_directories(folder);
  const auto digest = [&](const char* name, bool finds_lines, bool enabled) {
    const StereoRectifier rectifier(sequence.rig());
    StageTimes times;
    MapRecorder recorder(folder / name, MakeMapCalibration(sequence.rig(), rectifier), "stand-in",
                         std::string(64, '0'), times);
    OdometryOptions options;
    options.lines.enabled = enabled;
    const PipelineResult result = RunOn(sequence, &recorder, finds_lines, options);
    const Map read = ReadMap(folder / name);  // what was recorded is what is in memory
    EXPECT_EQ(read.line_landmarks.size(), result.map.line_landmarks.size());
    for (const auto& [id, line] : result.map.line_landmarks) {
      EXPECT_EQ(read.line_landmarks.at(id).ends_in_world.end, line.ends_in_world.end);
    }
    for (const auto& [id, keyframe] : result.map.keyframes) {
      EXPECT_EQ(read.keyframes.at(id).line_landmarks, keyframe.line_landmarks);
    }
    return MapDigest(folder / name);
  };
  const std::string with = digest("a.db", true, true);
  EXPECT_EQ(digest("b.db", true, true), with);
  const std::string without = digest("c.db", false, true);
  EXPECT_NE(without, with);
  EXPECT_EQ(digest("d.db", true, false), without);
  std::filesystem::remove_all(folder);
}

TEST(Pipeline, SkipsABrokenFrame) {
  const SyntheticSequence source(Options(8));
  const SpoiltSequence sequence(source, [](int index, StereoPair&) {
    if (index == 4) Fail("image 4 is broken");
  });
  const PipelineResult result = RunOn(sequence);
  EXPECT_EQ(result.records[4].state, FrameState::kSkipped);
  EXPECT_EQ(result.records[5].state, FrameState::kTracked);
  EXPECT_EQ(FinalTrajectory(result, 0).size(), 7u);
}

TEST(Pipeline, RecoversAfterAShortBlackout) {
  const SyntheticSequence source(Options(12));
  const SpoiltSequence sequence(source, [](int index, StereoPair& pair) {
    if (index == 6 || index == 7) pair.left.setTo(0);
  });
  const PipelineResult result = RunOn(sequence);
  EXPECT_EQ(result.records[6].state, FrameState::kLost);
  EXPECT_EQ(result.records[7].state, FrameState::kLost);
  EXPECT_FALSE(result.records[7].has_pose());
  for (int i = 8; i < 12; ++i) EXPECT_EQ(result.records[i].component, 0) << i;
  EXPECT_EQ(FinalTrajectory(result, 0).size(), 10u);
}

TEST(Pipeline, StartsANewComponentAndSavesTheLargest) {
  const SyntheticSequence source(Options(16));
  // After the dark the camera has been carried elsewhere: nothing matches the old keyframes.
  SyntheticSequenceOptions elsewhere = Options(16);
  elsewhere.trajectory = SyntheticTrajectory::Forward();
  elsewhere.world.seed = 99;
  const SyntheticSequence other(elsewhere);
  const SpoiltSequence sequence(source, [&](int index, StereoPair& pair) {
    if (index >= 5) pair = other.Read(index);
  });
  const PipelineResult result = RunOn(sequence);
  EXPECT_EQ(result.records[4].component, 0);
  EXPECT_FALSE(result.records[5].has_pose());
  EXPECT_EQ(result.records[15].component, 1);
  EXPECT_EQ(LargestComponent(result), 1);
  const Trajectory trajectory = FinalTrajectory(result, 1);
  EXPECT_EQ(trajectory.back().timestamp_ns, source.timestamp_ns(15));
  EXPECT_GT(trajectory.front().timestamp_ns, source.timestamp_ns(5));
}

class CountingDetector : public SyntheticDetector {
 public:
  Detections Detect(const cv::Mat& image, const cv::Mat& mask,
                    const DetectionRequest& request) override {
    ++calls;
    return SyntheticDetector::Detect(image, mask, request);
  }
  int calls = 0;
};

TEST(Pipeline, FeaturesAreDetectedWhereTheyAreNeeded) {
  const SyntheticSequence source(Options(24));
  // The camera stands still for a time, and then is where nothing expects it.
  const SpoiltSequence sequence(source, [&](int index, StereoPair& pair) {
    if (index >= 8 && index < 14) pair = source.Read(8);
  });
  const StereoRectifier rectifier(sequence.rig());
  CountingDetector detector;
  SyntheticDetector line_detector;
  SyntheticMatcher matcher;
  StageTimes times;
  std::vector<bool> detected;
  const auto observe = [&](const FrameObservation& seen) {
    detected.push_back(seen.features != nullptr);
    if (seen.keyframe != nullptr) {
      EXPECT_NE(seen.features, nullptr);
    }
  };
  const PipelineResult result = RunPipeline(
      sequence, rectifier, {}, {detector, line_detector, matcher}, nullptr, observe, times);
  EXPECT_EQ(std::count(detected.begin(), detected.end(), true), detector.calls);
  for (int i = 9; i < 14; ++i) EXPECT_FALSE(detected[i]) << i;  // patches alone
  for (const FrameRecord& record : result.records) EXPECT_TRUE(record.has_pose());
}

TEST(Pipeline, AStageThatThrowsEndsTheRun) {
  const SyntheticSequence sequence(Options(8));
  const StereoRectifier rectifier(sequence.rig());
  BrokenDetector broken;
  SyntheticDetector works({.lines = true});
  SyntheticMatcher matcher;
  StageTimes times;
  EXPECT_THROW(RunPipeline(sequence, rectifier, {}, {broken, works, matcher}, nullptr, {}, times),
               std::runtime_error);
  EXPECT_THROW(RunPipeline(sequence, rectifier, {}, {works, broken, matcher}, nullptr, {}, times),
               std::runtime_error);
}

TEST(Pipeline, StopsInOrderWhenAsked) {
  const SyntheticSequence source(Options(20));
  const PipelineResult whole = RunOn(source);
  std::atomic<bool> stop = false;
  const SpoiltSequence sequence(source, [&](int index, StereoPair&) { stop = index >= 9; });
  const StereoRectifier rectifier(sequence.rig());
  SyntheticDetector detector, line_detector;
  SyntheticMatcher matcher;
  StageTimes times;
  const PipelineResult result = RunPipeline(
      sequence, rectifier, {}, {detector, line_detector, matcher}, nullptr, {}, times, &stop);
  ASSERT_EQ(result.records.size(), 10u);  // frame 9 was under way
  const Trajectory online = OnlineTrajectory(result, 0), expected = OnlineTrajectory(whole, 0);
  ASSERT_EQ(online.size(), 10u);
  for (std::size_t i = 0; i < online.size(); ++i) {
    EXPECT_EQ(online[i].world_from_body.ToMatrix(), expected[i].world_from_body.ToMatrix()) << i;
  }
  EXPECT_EQ(FinalTrajectory(result, 0).size(), 10u);
}

TEST(Pipeline, FramesHangOnKeyframesThatExist) {
  const PipelineResult result = RunOn(SyntheticSequence(Options(20)));
  std::set<std::int64_t> keyframe_times;
  for (const auto& [id, keyframe] : result.map.keyframes) {
    keyframe_times.insert(keyframe.timestamp_ns);
    for (LandmarkId landmark : keyframe.landmarks) {
      EXPECT_TRUE(landmark == kNoLandmark || result.map.landmarks.contains(landmark));
    }
  }
  for (const FrameRecord& record : result.records) {
    EXPECT_TRUE(result.map.keyframes.contains(record.reference));
    EXPECT_EQ(record.is_keyframe, keyframe_times.contains(record.timestamp_ns));
  }
}

}  // namespace
}  // namespace airslam
