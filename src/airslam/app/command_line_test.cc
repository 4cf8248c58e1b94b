// SPDX-License-Identifier: BSD-3-Clause
//
// The real program: what it says to bad input, and the commands beside `map`.
#include "airslam/app/command_line.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <sstream>

#include "airslam/app/test_dataset.h"
#include "airslam/common/options.h"
#include "airslam/common/sha256.h"
#include "airslam/dataset/trajectory.h"
#include "airslam/evaluate/trajectory_error.h"
#include "airslam/map/map_file.h"
#include "airslam/odometry/options.h"
#include "airslam/refine/options.h"
#include "airslam/relocalize/localizer.h"

namespace airslam {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

// A failure is one sentence on the standard error stream that names what is wrong, and code 1.
void ExpectComplaint(const ProgramResult& run, const std::string& words) {
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_THAT(run.Complaints(), ElementsAre(AllOf(StartsWith("airslam: "), HasSubstr(words))));
  EXPECT_THAT(run.out, IsEmpty());
}

// Spoils a copy of the dataset, maps it and expects a complaint.
void ExpectDatasetComplaint(const std::function<void(const fs::path& euroc)>& spoil,
                            const std::string& words) {
  const TemporaryFolder folder;
  spoil(CopyOfEuroc(folder));
  ExpectComplaint(RunProgram(folder.path(), {"map", "euroc", "--out", "out"}), words);
  EXPECT_FALSE(fs::exists(folder.path() / "out"));
}

// Maps the good dataset with further arguments and expects a complaint.
void ExpectArgumentComplaint(const TemporaryFolder& folder, std::vector<std::string> further,
                             const std::string& words) {
  std::vector<std::string> arguments = {"map", TestDataset::Get().euroc(), "--out", "out"};
  arguments.insert(arguments.end(), further.begin(), further.end());
  ExpectComplaint(RunProgram(folder.path(), arguments), words);
}

TEST(Doctor, FindsThisMachineInOrder) {
  const TemporaryFolder folder;
  const ProgramResult run = RunProgram(folder.path(), {"doctor"});
  for (const char* part : {"solver", "map file", "models", "inference", "matcher"}) {
    EXPECT_THAT(Lines(run.out), Contains(AllOf(StartsWith("ok"), HasSubstr(part)))) << run.out;
  }
  for (const char* part : {"OpenVINO 20", "OpenCV 4", "Ceres 2", "Eigen 3", "SQLite 3"}) {
    EXPECT_THAT(Lines(run.out).front(), HasSubstr(part));
  }
  // Every file of the pack with its hash.
  const std::string pack = AIRSLAM_SOURCE_DIR "/models/airslam-fast";
  for (const auto& entry : fs::directory_iterator(pack)) {
    if (entry.path().extension() != ".onnx") continue;
    EXPECT_THAT(run.out,
                HasSubstr(FileSha256(entry.path()) + ' ' + entry.path().filename().string()));
  }
}

TEST(Doctor, SaysWhatToDoWhereFilesCannotBeMade) {
  const TemporaryFolder folder;
  const ProgramResult run =
      RunProgram(folder.path(), {"doctor"}, {.temporary_files = "/proc/nowhere"});
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_THAT(Lines(run.out), Contains(AllOf(StartsWith("WRONG  map file"), HasSubstr("TMPDIR"))));
}

TEST(Doctor, SaysWhatIsWrong) {
  const TemporaryFolder folder;
  folder.Write("pack/manifest.json", "{}");
  const ProgramResult run = RunProgram(folder.path(), {"doctor", "--model", "pack"});
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_THAT(Lines(run.out),
              Contains(AllOf(StartsWith("WRONG  models"), HasSubstr("manifest.json"))));
  EXPECT_THAT(run.Complaints(), ElementsAre(HasSubstr("something is wrong")));
}

TEST(CommandLine, WrongUsageIsCodeTwoAndOneSentence) {
  const TemporaryFolder folder;
  const std::vector<std::pair<std::vector<std::string>, std::string>> wrong = {
      {{}, "subcommand"},
      {{"mop"}, "mop is not a command"},
      {{"map", "somewhere"}, "--out is required; see airslam map --help"},
      {{"map", "somewhere", "--out", "out", "--oops"}, "--oops"},
      {{"features", "a.png", "b.png", "--max-keypoints", "many"}, "many"},
      {{"eval", "a.tum", "b.tum", "--delta", "-1"}, "--delta"},
  };
  for (const auto& [arguments, words] : wrong) {
    const ProgramResult run = RunProgram(folder.path(), arguments);
    EXPECT_EQ(run.exit_code, 2) << words;
    EXPECT_THAT(run.Complaints(), ElementsAre(AllOf(StartsWith("airslam: "), HasSubstr(words))));
  }
}

TEST(CommandLine, HelpAndVersionAreNoErrors) {
  const TemporaryFolder folder;
  const ProgramResult help = RunProgram(folder.path(), {"--help"});
  EXPECT_EQ(help.exit_code, 0);
  for (const char* command :
       {"map", "info", "features", "detect", "eval", "train-vocabulary", "localize"}) {
    EXPECT_THAT(help.out, HasSubstr(command));
  }
  EXPECT_THAT(RunProgram(folder.path(), {"map", "--help"}).out, HasSubstr("--config"));
  EXPECT_THAT(RunProgram(folder.path(), {"--version"}).out, StartsWith("airslam 0."));
}

// What it prints is a configuration file that changes nothing.
template <class Options>
void ExpectDefaults(const TemporaryFolder& folder, const std::string& command) {
  const ProgramResult yaml = RunProgram(folder.path(), {"options", command});
  ASSERT_EQ(yaml.exit_code, 0) << yaml.err;
  folder.Write("options.yaml", yaml.out);
  Options options;
  LoadOptions(folder.path() / "options.yaml", options);
  EXPECT_EQ(DumpOptions(options), DumpOptions(Options()));
}

TEST(CommandLine, OptionsPrintsAConfiguration) {
  const TemporaryFolder folder;
  ExpectDefaults<OdometryOptions>(folder, "map");
  ExpectDefaults<RefineOptions>(folder, "refine");
  ExpectDefaults<LocalizationOptions>(folder, "localize");
  const ProgramResult table = RunProgram(folder.path(), {"options", "map", "--markdown"});
  EXPECT_THAT(table.out, HasSubstr("| `max_keypoints` | `350` | 50 to 2000 |"));
  EXPECT_EQ(RunProgram(folder.path(), {"options", "mop"}).exit_code, 2);
}

TEST(CommandLine, SaysWhatIsWrongWithADataset) {
  const TemporaryFolder folder;
  fs::create_directories(folder.path() / "empty");
  folder.Write("strange/readme.txt", "no images");
  const std::vector<std::pair<std::string, std::string>> wrong = {
      {"nowhere", "nowhere does not exist"},
      {"empty", "empty is empty"},
      {"strange", "neither in the EuRoC layout"},
      {"strange/readme.txt", "is not a folder"},
  };
  for (const auto& [dataset, words] : wrong) {
    ExpectComplaint(RunProgram(folder.path(), {"map", dataset, "--out", "out"}), words);
  }
  EXPECT_FALSE(fs::exists(folder.path() / "out"));
}

TEST(CommandLine, SaysWhatIsWrongWithinADataset) {
  const SyntheticSequence& sequence = TestDataset::Get().sequence();
  const std::string third = std::to_string(sequence.timestamp_ns(2));
  ExpectDatasetComplaint(
      [&](const fs::path& euroc) {
        ReplaceInFile(euroc / "mav0/cam0/data.csv", third + ',', "1600000000000000000,");
      },
      "cam0/data.csv:4: the time 1600000000000000000 is not later than the one before it");
  ExpectDatasetComplaint(
      [](const fs::path& euroc) {
        ReplaceInFile(euroc / "mav0/cam0/sensor.yaml", "[320, 208]", "[376, 240]");
      },
      "has 320x208 pixels, but the calibration says 376x240");
  ExpectDatasetComplaint([](const fs::path& euroc) { fs::remove_all(euroc / "mav0/cam1"); },
                         "mav0/cam1 is missing");
  ExpectDatasetComplaint([](const fs::path& euroc) { fs::remove(euroc / "mav0/cam0/sensor.yaml"); },
                         "no calibration found");
}

TEST(CommandLine, SaysWhatIsWrongWithAConfiguration) {
  const TemporaryFolder folder;
  const std::vector<std::pair<std::string, std::string>> wrong = {
      {"tracking:\n  min_trackd: 20\n", "tracking.min_tracked"},
      {"local_map:\n  window: 1\n", "local_map.window is 1"},
      {"max_keypoints: lots\n", "max_keypoints"},
      {"max_keypoints: [\n", "options.yaml"},
  };
  for (const auto& [text, words] : wrong) {
    folder.Write("options.yaml", text);
    ExpectArgumentComplaint(folder, {"--config", "options.yaml"}, words);
  }
  ExpectArgumentComplaint(folder, {"--config", "nowhere.yaml"}, "nowhere.yaml");
}

// A bad escape in quotes goes on to the next line: the sentence about it does not.
TEST(CommandLine, WhatAFileHoldsBreaksNoSentence) {
  const TemporaryFolder folder;
  folder.Write("options.yaml", "\"a\\nb\": 3\n");
  ExpectArgumentComplaint(folder, {"--config", "options.yaml"}, "unknown option 'a b'");
}

TEST(CommandLine, SaysWhatIsWrongWithAModelPack) {
  const TemporaryFolder folder;
  ExpectArgumentComplaint(folder, {"--model", "no-such-pack"}, "no model pack 'no-such-pack'");
  const fs::path pack = folder.path() / "pack";
  CopyFolder(AIRSLAM_SOURCE_DIR "/models/airslam-fast", pack);
  std::string weights = ReadText(pack / "plnet.onnx");
  weights[weights.size() / 2] = static_cast<char>(weights[weights.size() / 2] ^ 1);
  folder.Write("pack/plnet.onnx", weights);
  ExpectArgumentComplaint(folder, {"--model", "pack"}, "the file is damaged");
  fs::remove(pack / "plnet.onnx");
  ExpectArgumentComplaint(folder, {"--model", "pack"}, "plnet.onnx: no such file");
  EXPECT_FALSE(fs::exists(folder.path() / "out"));
  EXPECT_FALSE(fs::exists(folder.path() / "out.partial"));
}

TEST(CommandLine, SaysWhenTheResultsCannotBeWritten) {
  const TemporaryFolder folder;
  folder.Write("file", "not a folder");
  for (const char* out : {"file/out", "file", "/proc/airslam/out", "/"}) {
    ExpectComplaint(RunProgram(folder.path(), {"map", TestDataset::Get().euroc(), "--out", out}),
                    out);
  }
  EXPECT_EQ(ReadText(folder.path() / "file"), "not a folder");
}

TEST(CommandLine, InfoPrintsWhatAMapHolds) {
  const TestDataset& data = TestDataset::Get();
  const fs::path map_file = data.result() / "map.db";
  const TemporaryFolder folder;
  const ProgramResult text = RunProgram(folder.path(), {"info", map_file});
  ASSERT_EQ(text.exit_code, 0) << text.err;
  EXPECT_THAT(text.out, HasSubstr("airslam-fast"));
  const ProgramResult json = RunProgram(folder.path(), {"info", data.result(), "--json"});
  ASSERT_EQ(json.exit_code, 0) << json.err;
  const Map map = ReadMap(map_file);
  const nlohmann::json summary = nlohmann::json::parse(json.out);
  EXPECT_EQ(summary["keyframes"], map.keyframes.size());
  EXPECT_EQ(summary["landmarks"], map.landmarks.size());
  EXPECT_EQ(summary["digest"], MapDigest(map_file));
}

TEST(CommandLine, InfoSaysWhatIsWrongWithAMap) {
  const TemporaryFolder folder;
  const fs::path truncated = folder.path() / "truncated.db";
  fs::copy_file(TestDataset::Get().result() / "map.db", truncated);
  fs::resize_file(truncated, fs::file_size(truncated) / 2);
  ExpectComplaint(RunProgram(folder.path(), {"info", "truncated.db"}), "truncated");
  folder.Write("text.db", std::string(5000, 'x'));
  ExpectComplaint(RunProgram(folder.path(), {"info", "text.db"}), "text.db");
  ExpectComplaint(RunProgram(folder.path(), {"info", "nowhere.db"}), "nowhere.db does not exist");
}

TEST(CommandLine, EvalPrintsTheErrorsOfATrajectory) {
  const TestDataset& data = TestDataset::Get();
  const TemporaryFolder folder;
  const fs::path truth = data.euroc() / "mav0/state_groundtruth_estimate0/data.csv";
  const fs::path estimate = data.result() / "trajectory.tum";
  const ProgramResult run =
      RunProgram(folder.path(), {"eval", truth, estimate, "--json", "eval.json"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_THAT(run.out, HasSubstr("alignment              SE(3)"));
  const TrajectoryErrors errors =
      EvaluateTrajectory(ReadTrajectory(truth), ReadTrajectory(estimate));
  EXPECT_THAT(run.out, HasSubstr(fmt::format("rmse {:.4f}", errors.position.rmse)));
  const nlohmann::json json = nlohmann::json::parse(ReadText(folder.path() / "eval.json"));
  EXPECT_EQ(json["ate_position_m"]["rmse"], errors.position.rmse);
  EXPECT_EQ(json["compared_poses"], kTestFrames);

  folder.Write("empty.tum", "");
  ExpectComplaint(RunProgram(folder.path(), {"eval", truth, "empty.tum"}), "empty.tum");
  ExpectComplaint(RunProgram(folder.path(), {"eval", truth, "nowhere.tum"}), "nowhere.tum");
}

TEST(CommandLine, FeaturesDrawsMatchesOfTwoImages) {
  const fs::path euroc = TestDataset::Get().euroc();
  const fs::path image0 = EurocImage(euroc, 0, 5), image1 = EurocImage(euroc, 0, 6);
  const TemporaryFolder folder;
  const ProgramResult run =
      RunProgram(folder.path(), {"features", image0, image1, "--out", "picture.png", "--csv",
                                 "matches.csv", "--matcher", "nearest"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_THAT(run.out, HasSubstr("airslam-fast"));
  const cv::Mat picture = cv::imread(folder.path() / "picture.png");
  EXPECT_EQ(picture.size(), cv::Size(640, 208));
  EXPECT_GT(Lines(ReadText(folder.path() / "matches.csv")).size(), 51u);
  // Something is drawn: the picture is not grey all over.
  cv::Mat channels[3];
  cv::split(picture, channels);
  EXPECT_GT(cv::countNonZero(channels[0] != channels[2]), 500);

  ExpectComplaint(RunProgram(folder.path(), {"features", image0, "nowhere.png"}),
                  "nowhere.png: no such picture");
  ExpectComplaint(RunProgram(folder.path(), {"features", image0, image1, "--out", "picture.xyz"}),
                  "picture.xyz");
}

// Rows of a table of numbers without a header.
std::vector<std::vector<double>> Table(const fs::path& file) {
  std::vector<std::vector<double>> rows;
  for (const std::string& line : Lines(ReadText(file))) {
    std::istringstream stream(line);
    rows.emplace_back();
    for (std::string value; std::getline(stream, value, ',');) rows.back().push_back(stod(value));
  }
  return rows;
}

// A bright rectangle with corners at (120, 100) and (520, 340) on a dark ground.
cv::Mat Rectangle(cv::Size size) {
  cv::Mat image(size, CV_8UC1, cv::Scalar(70));
  image(cv::Rect(120, 100, 400, 240)) = 180;
  return image;
}

// Whether a row of a table of lines is one of its sides.
bool IsSide(const std::vector<double>& line) {
  const auto near = [&](double x1, double y1, double x2, double y2) {
    const auto ends = [&](double a, double b, double c, double d) {
      return std::hypot(line[0] - a, line[1] - b) < 5 && std::hypot(line[2] - c, line[3] - d) < 5;
    };
    return ends(x1, y1, x2, y2) || ends(x2, y2, x1, y1);
  };
  return near(120, 100, 520, 100) || near(120, 340, 520, 340) || near(120, 100, 120, 340) ||
         near(520, 100, 520, 340);
}

TEST(CommandLine, DetectWritesKeypointsAndLines) {
  const TemporaryFolder folder;
  fs::create_directory(folder.path() / "in");
  folder.Write("in/notes.txt", "not a picture");
  cv::imwrite(folder.path() / "in" / "a.png", Rectangle({661, 455}));
  cv::imwrite(folder.path() / "in" / "b.JPG", Rectangle({640, 480}));
  const ProgramResult run =
      RunProgram(folder.path(), {"detect", "in", "--out", "new/out", "--draw"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_THAT(run.out, HasSubstr("2 pictures"));
  const fs::path out = folder.path() / "new" / "out";
  for (const std::string name : {"a", "b"}) {
    const auto keypoints = Table(out / (name + ".keypoints.csv"));
    ASSERT_FALSE(keypoints.empty());
    EXPECT_EQ(keypoints[0].size(), 3u);
    const auto lines = Table(out / (name + ".lines.csv"));
    ASSERT_FALSE(lines.empty());
    for (std::size_t i = 0; i < lines.size(); ++i) {
      ASSERT_EQ(lines[i].size(), 5u);
      EXPECT_LE(lines[i][4], lines[i > 0 ? i - 1 : 0][4]);  // best first
      EXPECT_GE(lines[i][0], 0);
      EXPECT_LE(lines[i][2], 660);
    }
    // At least one side of the rectangle is found.
    EXPECT_TRUE(std::any_of(lines.begin(), lines.end(), IsSide));
  }
  EXPECT_EQ(cv::imread(out / "a.features.png").size(), cv::Size(661, 455));
  EXPECT_EQ(std::distance(fs::directory_iterator(out), {}), 6);
  // A second run, on one of them, gives the same and leaves the other alone.
  const std::string before = ReadText(out / "a.lines.csv");
  EXPECT_EQ(RunProgram(folder.path(), {"detect", "in/a.png", "--out", "new/out"}).exit_code, 0);
  EXPECT_EQ(ReadText(out / "a.lines.csv"), before);
  EXPECT_TRUE(fs::exists(out / "b.lines.csv"));
}

TEST(CommandLine, DetectSaysWhatIsWrong) {
  const TemporaryFolder folder;
  fs::create_directory(folder.path() / "empty");
  folder.Write("broken/a.png", "no picture");
  folder.Write("twice/a.png", "");
  folder.Write("twice/a.jpg", "");
  cv::imwrite(folder.path() / "good.png", Rectangle({640, 480}));
  const auto expect = [&](std::vector<std::string> arguments, const std::string& words) {
    arguments.insert(arguments.begin(), "detect");
    ExpectComplaint(RunProgram(folder.path(), arguments), words);
    EXPECT_FALSE(fs::exists(folder.path() / "out"));
  };
  expect({"nowhere.png", "--out", "out"}, "nowhere.png: no such picture");
  expect({"empty", "--out", "out"}, "empty: no picture in this folder");
  expect({"broken", "--out", "out"}, "a.png: not a picture that can be read");
  expect({"twice", "--out", "out"}, "rename one of them");
  expect({"good.png", "--out", "out", "--model", "nothing"}, "no model pack 'nothing'");
  expect({"good.png", "--out", "good.png"}, "good.png: the folder of results cannot be created");
}

}  // namespace
}  // namespace airslam
