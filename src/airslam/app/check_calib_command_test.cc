// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "airslam/app/test_dataset.h"

namespace airslam {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::StartsWith;

TEST(CheckCalibCommand, FindsNothingWrongAndDraws) {
  const TemporaryFolder folder;
  const ProgramResult run = RunProgram(
      folder.path(), {"check-calib", TestDataset::Get().euroc(), "--frames", "8", "--out", "seen"});
  ASSERT_EQ(run.exit_code, 0) << run.err << run.out;
  EXPECT_THAT(Lines(run.out).back(), StartsWith("nothing is wrong: "));
  EXPECT_THAT(run.out, HasSubstr("vertical disparity"));
  const auto json = nlohmann::json::parse(ReadText(folder.path() / "seen" / "calibration.json"));
  EXPECT_TRUE(json["right"]);
  const int frame = json["frames"][0];
  const cv::Mat picture =
      cv::imread((folder.path() / "seen" / fmt::format("epipolar_{:06d}.png", frame)).string());
  EXPECT_EQ(picture.size(), cv::Size(640, 208));
}

TEST(CheckCalibCommand, SaysInOneSentenceWhatIsWrong) {
  const TemporaryFolder folder;
  const fs::path euroc = CopyOfEuroc(folder);
  fs::rename(euroc / "mav0/cam0/sensor.yaml", euroc / "left.yaml");
  fs::rename(euroc / "mav0/cam1/sensor.yaml", euroc / "mav0/cam0/sensor.yaml");
  fs::rename(euroc / "left.yaml", euroc / "mav0/cam1/sensor.yaml");
  const ProgramResult run =
      RunProgram(folder.path(), {"check-calib", "euroc", "--frames", "8", "--json"});
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_THAT(run.Complaints(), ElementsAre(StartsWith("airslam: swapped cameras")));
  const auto json = nlohmann::json::parse(run.out);
  EXPECT_FALSE(json["right"]);
  EXPECT_EQ(json["fault"], "swapped");
  EXPECT_EQ("airslam: " + json["sentence"].get<std::string>(), run.Complaints()[0]);
}

TEST(CheckCalibCommand, NamesAnotherResolution) {
  const TemporaryFolder folder;
  const fs::path euroc = CopyOfEuroc(folder);
  ReplaceInFile(euroc / "mav0/cam0/sensor.yaml", "[320, 208]", "[640, 416]");
  const ProgramResult run = RunProgram(folder.path(), {"check-calib", "euroc"});
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_THAT(run.Complaints(), ElementsAre(StartsWith("airslam: wrong resolution: ")));
}

}  // namespace
}  // namespace airslam
