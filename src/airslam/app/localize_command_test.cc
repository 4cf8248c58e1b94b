// SPDX-License-Identifier: BSD-3-Clause
//
// The real program: `airslam localize` in the map of the shared synthetic sequence, and
// `airslam train-vocabulary`.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

#include "airslam/app/test_dataset.h"
#include "airslam/dataset/trajectory.h"
#include "airslam/map/map_file.h"
#include "airslam/place/vocabulary.h"

namespace airslam {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::StartsWith;

std::string SensorYaml() { return TestDataset::Get().euroc() / "mav0/cam0/sensor.yaml"; }

TEST(LocalizeCommand, LocatesTheMapsOwnImages) {
  ASSERT_EQ(TestDataset::Get().run().exit_code, 0);
  const TemporaryFolder folder;
  const std::string map = TestDataset::Get().result();
  std::vector<std::string> arguments = {"localize", map};
  const std::vector<int> frames = {3, 8};
  for (const int frame : frames) {
    arguments.push_back(EurocImage(TestDataset::Get().euroc(), 0, frame));
  }
  arguments.insert(arguments.end(), {"--camera", SensorYaml(), "--out", "poses.tum"});
  const ProgramResult run = RunProgram(folder.path(), arguments);
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_THAT(run.err, HasSubstr("no junction words"));
  const std::vector<std::string> lines = Lines(run.out);
  ASSERT_EQ(lines.size(), 3U);
  EXPECT_THAT(lines[0], AllOf(HasSubstr("inliers with keyframe"), HasSubstr("verify")));
  EXPECT_THAT(lines[2], StartsWith("2 of 2 queries located"));
  const Trajectory poses = ReadTrajectory(folder.path() / "poses.tum");
  const Trajectory mapped = ReadTrajectory(TestDataset::Get().result() / "trajectory.tum");
  ASSERT_EQ(poses.size(), 2U);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const StampedPose& truth = mapped[static_cast<std::size_t>(frames[i])];
    ASSERT_EQ(poses[i].timestamp_ns, truth.timestamp_ns);
    const Rigid3 error = poses[i].world_from_body.Inverse() * truth.world_from_body;
    EXPECT_LT(error.translation.norm(), 0.05);
    EXPECT_LT(error.Angle(), 0.01);
  }
}

TEST(LocalizeCommand, ARefusalIsNoFailure) {
  const TemporaryFolder folder;
  fs::create_directories(folder.path() / "queries");
  cv::imwrite(folder.path() / "queries/grey.png", cv::Mat(208, 320, CV_8UC1, cv::Scalar(90)));
  const ProgramResult run =
      RunProgram(folder.path(), {"localize", TestDataset::Get().result(), "queries", "--camera",
                                 SensorYaml(), "--out", "poses.tum"});
  EXPECT_EQ(run.exit_code, 0) << run.err;
  EXPECT_THAT(Lines(run.out),
              ElementsAre(StartsWith("grey.png: refused at "), StartsWith("0 of 1 queries")));
  EXPECT_TRUE(fs::exists(folder.path() / "poses.tum"));
}

TEST(LocalizeCommand, TheConfigurationDecidesAndArgumentsOverrideIt) {
  const TemporaryFolder folder;
  folder.Write("options.yaml", "min_inliers: 9000\nsure_inliers: 10000\ncandidates: 0\n");
  std::vector<std::string> arguments = {"localize",
                                        TestDataset::Get().result(),
                                        EurocImage(TestDataset::Get().euroc(), 0, 3),
                                        "--camera",
                                        SensorYaml(),
                                        "--config",
                                        "options.yaml"};
  const ProgramResult wrong = RunProgram(folder.path(), arguments);
  EXPECT_EQ(wrong.exit_code, 1);
  EXPECT_THAT(wrong.err, HasSubstr("candidates is 0"));
  folder.Write("options.yaml", "min_inliers: 9000\nsure_inliers: 10000\n");
  arguments.insert(arguments.end(), {"--candidates", "1"});
  const ProgramResult run = RunProgram(folder.path(), arguments);
  EXPECT_EQ(run.exit_code, 0) << run.err;
  EXPECT_THAT(run.out, HasSubstr("agree on a pose, more than 9000 are needed"));
}

TEST(LocalizeCommand, SaysWhatIsWrong) {
  const TemporaryFolder folder;
  cv::imwrite(folder.path() / "small.png", cv::Mat(20, 30, CV_8UC1, cv::Scalar(90)));
  MapWriter(folder.path() / "other.db", MapCalibration{}, "other", "0123456789abcdef").Close();
  const auto complaint = [&](const std::string& map, const std::string& query,
                             const std::string& camera) {
    const ProgramResult run =
        RunProgram(folder.path(), {"localize", map, query, "--camera", camera});
    EXPECT_EQ(run.exit_code, 1);
    return run.err;
  };
  const std::string map = TestDataset::Get().result();
  EXPECT_THAT(complaint("nowhere.db", "small.png", SensorYaml()), HasSubstr("nowhere.db"));
  EXPECT_THAT(complaint(map, "small.png", "nowhere.yaml"), HasSubstr("nowhere.yaml"));
  EXPECT_THAT(complaint(map, "small.png", SensorYaml()), HasSubstr("30x20 pixels"));
  EXPECT_THAT(complaint(map, "missing.png", SensorYaml()), HasSubstr("missing.png"));
  EXPECT_THAT(complaint("other.db", "small.png", SensorYaml()),
              HasSubstr("made with the model pack other"));
}

TEST(TrainVocabularyCommand, MakesAVocabularyOfAFolder) {
  const TemporaryFolder folder;
  const ProgramResult run =
      RunProgram(folder.path(), {"train-vocabulary", TestDataset::Get().euroc() / "mav0/cam0/data",
                                 "--out", "words.bin", "--branching", "5", "--levels", "2"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_THAT(run.out, AllOf(StartsWith("25 words from"), HasSubstr("vocabulary in words.bin")));
  const Vocabulary vocabulary = Vocabulary::Read(folder.path() / "words.bin");
  EXPECT_EQ(vocabulary.words(), 25);
  EXPECT_EQ(vocabulary.network_sha256(),
            ReadMap(TestDataset::Get().result() / "map.db").model_pack_sha256);
  const ProgramResult wrong = RunProgram(
      folder.path(), {"train-vocabulary", folder.path(), "--out", "words.bin", "--levels", "9"});
  EXPECT_EQ(wrong.exit_code, 1);
  EXPECT_THAT(wrong.err, HasSubstr("levels = 9 must be 1 to 8"));
}

}  // namespace
}  // namespace airslam
