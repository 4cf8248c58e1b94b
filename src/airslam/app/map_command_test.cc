// SPDX-License-Identifier: BSD-3-Clause
//
// The real program on real folders: what `airslam map` writes, and what it leaves when it is
// stopped or fails.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <nlohmann/json.hpp>
#include <numeric>
#include <thread>

#include "airslam/app/test_dataset.h"
#include "airslam/dataset/trajectory.h"
#include "airslam/evaluate/trajectory_error.h"
#include "airslam/map/map_file.h"

namespace airslam {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

nlohmann::json Report(const fs::path& result) {
  return nlohmann::json::parse(ReadText(result / "report.json"));
}

int CountStates(const nlohmann::json& report, const std::string& state) {
  int count = 0;
  for (const nlohmann::json& frame : report["frame_states"]) count += frame["state"] == state;
  return count;
}

// Frames in lists that name the same few images forth and back: a long run at little cost.
std::string ForthAndBack(int index) {
  const int period = 2 * (kTestFrames - 1);
  const int phase = index % period;
  const int image = phase < kTestFrames ? phase : period - phase;
  return fmt::format("{}.png", TestDataset::Get().sequence().timestamp_ns(image));
}

void ExpectSameResult(const fs::path& a, const fs::path& b) {
  for (const char* file : {"trajectory.tum", "trajectory_online.tum", "keyframes.tum"}) {
    EXPECT_EQ(ReadText(a / file), ReadText(b / file)) << file;
  }
  EXPECT_EQ(MapDigest(a / "map.db"), MapDigest(b / "map.db"));
}

TEST(MapCommand, NeedsNoEnvironmentAndWritesEverything) {
  const TestDataset& data = TestDataset::Get();
  ASSERT_EQ(data.run().exit_code, 0) << data.run().err;
  std::set<std::string> files;
  for (const auto& entry : fs::directory_iterator(data.result())) {
    files.insert(entry.path().filename());
  }
  EXPECT_THAT(files, ElementsAre("keyframes.tum", "map.db", "report.json", "trajectory.tum",
                                 "trajectory_online.tum"));
  EXPECT_FALSE(fs::exists(data.result().string() + ".partial"));
  EXPECT_THAT(data.run().out, StartsWith("20 of 20 frames in the trajectory"));
  EXPECT_THAT(data.run().err, HasSubstr("map 20/20"));
}

TEST(MapCommand, EveryFrameIsWithinCentimetresOfTheTruth) {
  const TestDataset& data = TestDataset::Get();
  for (const char* file : {"trajectory.tum", "trajectory_online.tum"}) {
    const Trajectory estimate = ReadTrajectory(data.result() / file);
    ASSERT_EQ(estimate.size(), static_cast<std::size_t>(kTestFrames)) << file;
    for (int i = 0; i < kTestFrames; ++i) {
      EXPECT_EQ(estimate[i].timestamp_ns, data.sequence().timestamp_ns(i));
    }
    const TrajectoryErrors errors = EvaluateTrajectory(data.sequence().ground_truth(), estimate);
    EXPECT_GT(errors.path_length, 0.5);
    EXPECT_LT(errors.position.rmse, 0.05) << file;
  }
}

TEST(MapCommand, TheMapHoldsTheKeyframesOfTheTrajectory) {
  const TestDataset& data = TestDataset::Get();
  const Map map = ReadMap(data.result() / "map.db");
  const Trajectory keyframes = ReadTrajectory(data.result() / "keyframes.tum");
  const Trajectory frames = ReadTrajectory(data.result() / "trajectory.tum");
  EXPECT_EQ(map.model_pack, "airslam-fast");
  EXPECT_GE(keyframes.size(), 2u);
  ASSERT_EQ(map.keyframes.size(), keyframes.size());
  auto pose = keyframes.begin();
  for (const auto& [id, keyframe] : map.keyframes) {
    EXPECT_EQ(keyframe.timestamp_ns, pose->timestamp_ns);
    // A keyframe's own frame has its pose.
    const auto frame = std::find_if(frames.begin(), frames.end(), [&](const StampedPose& p) {
      return p.timestamp_ns == keyframe.timestamp_ns;
    });
    ASSERT_NE(frame, frames.end());
    EXPECT_LT((frame->world_from_body.translation - pose->world_from_body.translation).norm(),
              1e-6);
    ++pose;
  }
}

TEST(MapCommand, TheReportAddsUp) {
  const TestDataset& data = TestDataset::Get();
  const nlohmann::json report = Report(data.result());
  const int frames = report["frames"];
  EXPECT_EQ(frames, kTestFrames);
  EXPECT_EQ(report["frame_states"].size(), report["frames"]);
  const int posed = CountStates(report, "initialized") + CountStates(report, "tracked");
  EXPECT_EQ(report["frames_with_pose"], posed);
  EXPECT_EQ(posed + CountStates(report, "lost") + CountStates(report, "skipped"), frames);
  EXPECT_EQ(report["frames_in_trajectory"],
            ReadTrajectory(data.result() / "trajectory.tum").size());
  const Map map = ReadMap(data.result() / "map.db");
  EXPECT_EQ(report["keyframes"], map.keyframes.size());
  EXPECT_EQ(report["landmarks"], map.landmarks.size());
  EXPECT_EQ(report["components"], 1);
  EXPECT_TRUE(report["lost_intervals"].empty());
  EXPECT_NEAR(report["frames_per_second"].get<double>(),
              frames / report["wall_seconds"].get<double>(), 1e-6);

  for (const char* stage : {"read", "rectify left"}) {
    EXPECT_EQ(report["stages"][stage]["count"], frames) << stage;
  }
  EXPECT_GE(report["stages"]["detect left"]["count"], report["keyframes"]);
  EXPECT_LT(report["stages"]["detect left"]["count"], frames);  // most need no features
  EXPECT_EQ(report["stages"]["track"]["count"], frames - 1);
  EXPECT_EQ(report["stages"]["local bundle"]["count"], report["keyframes"]);
  for (const auto& [name, stage] : report["stages"].items()) {
    const double total = stage["total_ms"], mean = stage["mean_ms"], count = stage["count"];
    EXPECT_NEAR(total, mean * count, 1e-6 * total) << name;
    EXPECT_LE(stage["median_ms"], stage["p95_ms"]) << name;
    EXPECT_LE(stage["p95_ms"], stage["max_ms"]) << name;
  }
}

TEST(MapCommand, ASecondRunGivesTheSameBytesFromMav0ItselfAndRelativePaths) {
  const TestDataset& data = TestDataset::Get();
  const TemporaryFolder folder;
  fs::create_directory_symlink(data.euroc() / "mav0", folder.path() / "sequence");
  const ProgramResult run = RunProgram(folder.path(), {"map", "sequence", "--out", "a/b/"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  ExpectSameResult(data.result(), folder.path() / "a" / "b");
}

TEST(MapCommand, RecognisesAKittiFolder) {
  SyntheticSequenceOptions options;
  options.rig = KittiLikeRig(320, 208);
  options.frames = 10;
  const SyntheticSequence sequence(options);
  const TemporaryFolder folder;
  WriteKittiFolder(sequence, folder.path() / "kitti");
  const ProgramResult run = RunProgram(folder.path(), {"map", "kitti", "--out", "out"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const TrajectoryErrors errors =
      EvaluateTrajectory(ReadTrajectory(folder.path() / "kitti" / "poses.txt"),
                         ReadTrajectory(folder.path() / "out" / "trajectory.tum"));
  EXPECT_EQ(errors.compared_poses, 10);
  EXPECT_LT(errors.position.rmse, 0.05);
}

TEST(MapCommand, ReadsAConfiguration) {
  const TemporaryFolder folder;
  folder.Write("options.yaml", "max_keypoints: 120\nlocal_map:\n  window: 4\n");
  const ProgramResult run = RunProgram(folder.path(), {"map", TestDataset::Get().euroc().string(),
                                                       "--out", "out", "--config", "options.yaml"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_THAT(Report(folder.path() / "out")["options"].get<std::string>(),
              HasSubstr("max_keypoints: 120"));
  const auto keypoints = [](const fs::path& result) {
    return ReadMap(result / "map.db").keyframes.begin()->second.keypoints.size();
  };
  EXPECT_LE(keypoints(folder.path() / "out"), 120u);
  EXPECT_GT(keypoints(TestDataset::Get().result()), 120u);
}

TEST(MapCommand, SkipsBrokenFramesWithAWarningEach) {
  const TemporaryFolder folder;
  const fs::path euroc = CopyOfEuroc(folder);
  const fs::path missing = EurocImage(euroc, 0, 8), truncated = EurocImage(euroc, 1, 13);
  fs::remove(missing);
  fs::resize_file(truncated, fs::file_size(truncated) / 2);
  const ProgramResult run = RunProgram(folder.path(), {"map", "euroc", "--out", "out"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_THAT(run.err, HasSubstr("airslam: warning: frame 8 skipped: "));
  EXPECT_THAT(run.err, HasSubstr(missing.filename().string()));
  EXPECT_THAT(run.err, HasSubstr("airslam: warning: frame 13 skipped: "));
  EXPECT_THAT(run.err, HasSubstr(truncated.filename().string()));
  const nlohmann::json report = Report(folder.path() / "out");
  EXPECT_EQ(report["frames_skipped"], 2);
  EXPECT_EQ(report["frame_states"][8]["state"], "skipped");
  EXPECT_EQ(report["frame_states"][13]["state"], "skipped");
  EXPECT_EQ(report["lost_intervals"].size(), 2u);
  EXPECT_EQ(ReadTrajectory(folder.path() / "out" / "trajectory.tum").size(), kTestFrames - 2u);
}

TEST(MapCommand, ASequenceThatIsLostAllTheWayIsStillProcessed) {
  const TemporaryFolder folder;
  const fs::path euroc = CopyOfEuroc(folder);
  for (int camera : {0, 1}) {
    cv::imwrite(euroc / fmt::format("mav0/cam{}/data/black.png", camera),
                cv::Mat::zeros(208, 320, CV_8UC1));
  }
  ListImages(euroc, 8, [](int) { return "black.png"; });
  const ProgramResult run = RunProgram(folder.path(), {"map", "euroc", "--out", "out"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_THAT(run.err, HasSubstr("airslam: warning: no frame could be tracked"));
  EXPECT_EQ(fs::file_size(folder.path() / "out" / "trajectory.tum"), 0u);
  EXPECT_THAT(ReadMap(folder.path() / "out" / "map.db").keyframes, IsEmpty());
  const nlohmann::json report = Report(folder.path() / "out");
  EXPECT_EQ(report["frames_with_pose"], 0);
  EXPECT_EQ(report["components"], 0);
  EXPECT_EQ(CountStates(report, "lost"), 8);
  ASSERT_EQ(report["lost_intervals"].size(), 1u);
  EXPECT_EQ(report["lost_intervals"][0]["frames"], 8);
  EXPECT_EQ(RunProgram(folder.path(), {"info", "out"}).exit_code, 0);
}

TEST(MapCommand, SaysWhatBecameOfTheImu) {
  const TestDataset& data = TestDataset::Get();
  const nlohmann::json with = Report(data.result())["inertial"];
  EXPECT_GT(with["readings"], 300);  // 200 Hz over 1.9 s
  EXPECT_NE(with["state"], "off");
  const TemporaryFolder folder;
  const fs::path euroc = CopyOfEuroc(folder);
  ASSERT_EQ(RunProgram(folder.path(), {"map", "euroc", "--out", "off", "--no-imu"}).exit_code, 0);
  EXPECT_EQ(Report(folder.path() / "off")["inertial"]["state"], "off");
  fs::remove(euroc / "mav0" / "imu0" / "data.csv");
  const ProgramResult run = RunProgram(folder.path(), {"map", "euroc", "--out", "missing"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_THAT(run.err, HasSubstr("data.csv is missing: no IMU is used"));
  EXPECT_EQ(Report(folder.path() / "missing")["inertial"]["state"], "no readings");
  ExpectSameResult(folder.path() / "off", folder.path() / "missing");
}

TEST(MapCommand, ReplacesAnEarlierResultAsAWhole) {
  const TestDataset& data = TestDataset::Get();
  const TemporaryFolder folder;
  folder.Write("out/report.json", "{}");
  folder.Write("out/stale.txt", "of an earlier run");
  folder.Write("out.partial/map.db", "of a run that was killed");
  const ProgramResult run = RunProgram(folder.path(), {"map", data.euroc(), "--out", "out"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_FALSE(fs::exists(folder.path() / "out" / "stale.txt"));
  EXPECT_FALSE(fs::exists(folder.path() / "out.partial"));
  ExpectSameResult(data.result(), folder.path() / "out");
}

TEST(MapCommand, LeavesAFolderThatIsNotItsOwn) {
  const TemporaryFolder folder;
  folder.Write("out/thesis.txt", "three years of work");
  const ProgramResult run =
      RunProgram(folder.path(), {"map", TestDataset::Get().euroc(), "--out", "out"});
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_THAT(run.Complaints(), ElementsAre(HasSubstr("will not be replaced")));
  EXPECT_EQ(ReadText(folder.path() / "out" / "thesis.txt"), "three years of work");
  EXPECT_FALSE(fs::exists(folder.path() / "out.partial"));
}

// The disk is full in the middle of the run.
TEST(MapCommand, ARunThatFailsLeavesTheEarlierResult) {
  const TestDataset& data = TestDataset::Get();
  const TemporaryFolder folder;
  CopyFolder(data.result(), folder.path() / "out");
  const ProgramResult run =
      RunProgram(folder.path(), {"map", data.euroc(), "--out", "out"}, {.file_bytes = 100'000});
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_THAT(run.Complaints(), ElementsAre(StartsWith("airslam: ")));
  EXPECT_THAT(run.err, HasSubstr("map.db"));
  ExpectSameResult(data.result(), folder.path() / "out");
}

// As `map_file` holds it now; 0 while it cannot be read.
std::size_t KeyframesIn(const fs::path& map_file) {
  try {
    return fs::exists(map_file) ? ReadMap(map_file).keyframes.size() : 0;
  } catch (const std::exception&) {
    return 0;
  }
}

TEST(MapCommand, AKilledRunLeavesTheMapSoFar) {
  const TestDataset& data = TestDataset::Get();
  const TemporaryFolder folder;
  const fs::path euroc = CopyOfEuroc(folder);
  ListImages(euroc, 20'000, ForthAndBack);  // minutes: it is killed long before its end
  CopyFolder(data.result(), folder.path() / "out");
  Program program(folder.path(), {"map", "euroc", "--out", "out"}, {});
  const fs::path map_file = folder.path() / "out.partial" / "map.db";
  std::size_t committed = 0;
  while (committed < 2 && program.IsRunning()) {
    committed = KeyframesIn(map_file);
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  program.Kill();
  const ProgramResult run = program.Wait();
  ASSERT_EQ(run.exit_code, 128 + SIGKILL) << run.err;

  const Map map = ReadMap(map_file);
  EXPECT_GE(map.keyframes.size(), committed);
  EXPECT_GE(map.keyframes.size(), 2u);
  const Map whole = ReadMap(data.result() / "map.db");
  EXPECT_EQ(map.keyframes.at(0).timestamp_ns, whole.keyframes.at(0).timestamp_ns);
  EXPECT_EQ(map.keyframes.at(1).timestamp_ns, whole.keyframes.at(1).timestamp_ns);
  EXPECT_EQ(RunProgram(folder.path(), {"info", map_file}).exit_code, 0);
  ExpectSameResult(data.result(), folder.path() / "out");
}

// Frames until the end would take minutes; the signal comes when some keyframes are committed.
ProgramResult RunUntilSignal(const TemporaryFolder& folder, int signal_number) {
  ListImages(CopyOfEuroc(folder), 20'000, ForthAndBack);
  Program program(folder.path(), {"map", "euroc", "--out", "out"}, {});
  while (KeyframesIn(folder.path() / "out.partial" / "map.db") < 2 && program.IsRunning()) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  program.Send(signal_number);
  return program.Wait();
}

TEST(MapCommand, ASignalEndsTheRunInOrder) {
  for (const auto& [number, name] : {std::pair{SIGTERM, "SIGTERM"}, {SIGINT, "SIGINT"}}) {
    const TemporaryFolder folder;
    const ProgramResult run = RunUntilSignal(folder, number);
    EXPECT_EQ(run.exit_code, 128 + number) << run.err;
    const nlohmann::json report = Report(folder.path() / "out");
    const int frames = report["frames"];
    EXPECT_GE(frames, 2);
    EXPECT_LT(frames, 20'000);
    EXPECT_EQ(report["frames_in_sequence"], 20'000);
    EXPECT_EQ(report["stopped_by"], name);
    EXPECT_THAT(run.Complaints(),
                ElementsAre(fmt::format(
                    "airslam: stopped by {} after {} of 20000 frames: results up to there in out",
                    name, frames)));
    // The trajectory is whole: every frame up to there, and the map is that of these frames.
    EXPECT_EQ(ReadTrajectory(folder.path() / "out" / "trajectory.tum").size(),
              static_cast<std::size_t>(frames));
    const Map map = ReadMap(folder.path() / "out" / "map.db");
    EXPECT_EQ(map.keyframes.size(), report["keyframes"]);
    EXPECT_EQ(map.keyframes.size(), ReadTrajectory(folder.path() / "out" / "keyframes.tum").size());
    EXPECT_FALSE(fs::exists(folder.path() / "out.partial"));
  }
}

}  // namespace
}  // namespace airslam
