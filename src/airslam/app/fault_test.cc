// SPDX-License-Identifier: BSD-3-Clause
//
// What can go wrong around the program while it runs. docs/robustness.md lists these and those that
// other tests hold: a kill -9, a signal, a full disk, a damaged map (map_command_test.cc,
// map/map_damage_test.cc).
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <nlohmann/json.hpp>
#include <opencv2/imgproc.hpp>
#include <thread>

#include "airslam/app/test_dataset.h"
#include "airslam/dataset/trajectory.h"
#include "airslam/map/map_file.h"

namespace airslam {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

void ExpectSameResult(const fs::path& a, const fs::path& b) {
  for (const char* file : {"trajectory.tum", "trajectory_online.tum", "keyframes.tum"}) {
    EXPECT_EQ(ReadText(a / file), ReadText(b / file)) << file;
  }
  EXPECT_EQ(MapDigest(a / "map.db"), MapDigest(b / "map.db"));
}

TEST(Fault, ImagesThatChangeSizeAreSkipped) {
  const TemporaryFolder folder;
  const fs::path euroc = CopyOfEuroc(folder);
  const fs::path small = EurocImage(euroc, 0, 9), large = EurocImage(euroc, 1, 12);
  cv::imwrite(small, cv::Mat(104, 160, CV_8UC1, cv::Scalar(90)));
  cv::imwrite(large, cv::Mat(416, 640, CV_8UC1, cv::Scalar(90)));
  const ProgramResult run = RunProgram(folder.path(), {"map", "euroc", "--out", "out"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  for (const auto& [frame, words] :
       {std::pair{9, "has 160x104 pixels"}, {12, "has 640x416 pixels"}}) {
    EXPECT_THAT(run.err, HasSubstr(fmt::format("warning: frame {} skipped: ", frame)));
    EXPECT_THAT(run.err, HasSubstr(words));
  }
  EXPECT_EQ(ReadTrajectory(folder.path() / "out" / "trajectory.tum").size(), kTestFrames - 2u);
}

TEST(Fault, SixteenBitsAndColourAmongOthersChangeNothing) {
  const TemporaryFolder folder;
  const fs::path euroc = CopyOfEuroc(folder);
  for (int camera : {0, 1}) {
    cv::Mat image = cv::imread(EurocImage(euroc, camera, 5), cv::IMREAD_GRAYSCALE), other;
    image.convertTo(other, CV_16U, 257);
    cv::imwrite(EurocImage(euroc, camera, 5), other);
    image = cv::imread(EurocImage(euroc, camera, 7), cv::IMREAD_GRAYSCALE);
    cv::cvtColor(image, other, cv::COLOR_GRAY2BGR);
    cv::imwrite(EurocImage(euroc, camera, 7), other);
  }
  const ProgramResult run = RunProgram(folder.path(), {"map", "euroc", "--out", "out"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  ExpectSameResult(TestDataset::Get().result(), folder.path() / "out");
}

TEST(Fault, NumbersThatAreNoneInTheImuAreNamed) {
  for (const char* word : {"nan", "inf", "1e999", "x"}) {
    const TemporaryFolder folder;
    const fs::path csv = CopyOfEuroc(folder) / "mav0" / "imu0" / "data.csv";
    std::vector<std::string> lines = Lines(ReadText(csv));
    lines[20].replace(lines[20].find(',') + 1, 1, word);
    std::ofstream stream(csv);
    for (const std::string& line : lines) stream << line << '\n';
    stream.close();
    const ProgramResult run = RunProgram(folder.path(), {"map", "euroc", "--out", "out"});
    EXPECT_EQ(run.exit_code, 1);
    EXPECT_THAT(run.Complaints(),
                ElementsAre(AllOf(HasSubstr("imu0/data.csv:21: "), HasSubstr("is not a number"))));
    EXPECT_FALSE(fs::exists(folder.path() / "out"));
  }
}

// As when a disk is pulled while it is read: the rest is skipped, what was mapped stays.
TEST(Fault, ImagesThatVanishWhileTheyAreRead) {
  const TemporaryFolder folder;
  const fs::path euroc = CopyOfEuroc(folder);
  const int frames = 20'000;
  ListImages(euroc, frames, [](int index) {
    const int phase = index % (2 * (kTestFrames - 1));
    const int image = phase < kTestFrames ? phase : 2 * (kTestFrames - 1) - phase;
    return fmt::format("{}.png", TestDataset::Get().sequence().timestamp_ns(image));
  });
  Program program(folder.path(), {"map", "euroc", "--out", "out"}, {});
  const auto keyframes = [&]() -> std::size_t {
    try {
      return ReadMap(folder.path() / "out.partial" / "map.db").keyframes.size();
    } catch (const std::exception&) {
      return 0;  // not yet made
    }
  };
  while (keyframes() < 2 && program.IsRunning()) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  fs::remove_all(euroc / "mav0" / "cam0" / "data");
  const ProgramResult run = program.Wait();
  EXPECT_EQ(run.exit_code, 0) << run.err.substr(0, 1000);
  EXPECT_THAT(run.err, HasSubstr(".png is missing"));
  const nlohmann::json report =
      nlohmann::json::parse(ReadText(folder.path() / "out" / "report.json"));
  const int posed = report["frames_with_pose"], skipped = report["frames_skipped"];
  EXPECT_GE(posed, 2);
  EXPECT_EQ(report["frames"], frames);
  EXPECT_GT(skipped, 0);
  EXPECT_GE(ReadMap(folder.path() / "out" / "map.db").keyframes.size(), 2u);
}

TEST(Fault, FullDevices) {
  const TemporaryFolder folder;
  const fs::path result = TestDataset::Get().result();
  // The standard output.
  const ProgramResult info =
      RunProgram(folder.path(), {"info", result}, {.standard_output = "/dev/full"});
  EXPECT_EQ(info.exit_code, 1);
  EXPECT_THAT(info.Complaints(), ElementsAre("airslam: the standard output cannot be written"));
  // A table.
  const std::string image = EurocImage(TestDataset::Get().euroc(), 0, 0);
  const ProgramResult table =
      RunProgram(folder.path(), {"features", image, image, "--csv", "/dev/full"});
  EXPECT_EQ(table.exit_code, 1);
  EXPECT_THAT(table.Complaints(), ElementsAre(HasSubstr("/dev/full")));
}

}  // namespace
}  // namespace airslam
