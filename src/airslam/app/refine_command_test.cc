// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "airslam/app/test_dataset.h"
#include "airslam/map/map_file.h"

namespace airslam {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

std::string InputMap() { return (TestDataset::Get().result() / "map.db").string(); }

// The complaints: what is neither a warning nor a line of progress ("name done/total").
std::vector<std::string> Complaints(const ProgramResult& result) {
  std::vector<std::string> lines = result.Complaints();
  std::erase_if(lines, [](const std::string& line) { return !line.starts_with("airslam: "); });
  return lines;
}

TEST(RefineCommand, WritesARefinedMapAndLeavesItsInput) {
  const TemporaryFolder folder;
  const std::string before = ReadText(InputMap());
  const ProgramResult result =
      RunProgram(folder.path(), {"refine", InputMap(), "--out", "b.db", "--report", "report.json"});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_THAT(Complaints(result), IsEmpty());
  EXPECT_EQ(ReadText(InputMap()), before) << "the input is not touched, not by a byte";
  EXPECT_FALSE(fs::exists(InputMap() + "-wal"));
  const Map input = ReadMap(InputMap()), output = ReadMap(folder.path() / "b.db");
  ASSERT_EQ(output.keyframes.size(), input.keyframes.size());
  EXPECT_EQ(output.keyframes.begin()->second.world_from_cam.translation,
            input.keyframes.begin()->second.world_from_cam.translation);
  for (const auto& [id, keyframe] : input.keyframes) {
    EXPECT_LT(
        (output.keyframes.at(id).world_from_cam.translation - keyframe.world_from_cam.translation)
            .norm(),
        0.05);
  }
  const nlohmann::json report = nlohmann::json::parse(ReadText(folder.path() / "report.json"));
  EXPECT_EQ(report["steps"].size(), 5u);
  EXPECT_LE(report["after"]["reprojection_rms_px"].get<double>(),
            report["before"]["reprojection_rms_px"].get<double>() + 0.05);
  EXPECT_TRUE(fs::exists(folder.path() / "report.png"));
}

TEST(RefineCommand, TwoRunsMakeTheSameMap) {
  const TemporaryFolder folder;
  for (const char* out : {"a.db", "b.db"}) {
    ASSERT_EQ(RunProgram(folder.path(), {"refine", InputMap(), "--out", out}).exit_code, 0);
  }
  EXPECT_EQ(MapDigest(folder.path() / "a.db"), MapDigest(folder.path() / "b.db"));
}

TEST(RefineCommand, TheConfigurationChoosesTheProcessors) {
  const TemporaryFolder folder;
  std::ofstream(folder.path() / "c.yaml")
      << "processors: global_bundle\nglobal_bundle:\n  fine_iterations: 3\n";
  const ProgramResult result =
      RunProgram(folder.path(), {"refine", InputMap(), "--out", "b.db", "--config", "c.yaml"});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("global_bundle"));
  EXPECT_THAT(result.out, ::testing::Not(HasSubstr("pose_graph")));
}

TEST(RefineCommand, SaysWhatIsWrongInOneSentence) {
  const TemporaryFolder folder;
  const auto expect = [&](std::vector<std::string> arguments, const std::string& word) {
    arguments.insert(arguments.begin(), "refine");
    const ProgramResult result = RunProgram(folder.path(), arguments);
    EXPECT_EQ(result.exit_code, 1);
    EXPECT_EQ(Complaints(result).size(), 1u) << result.err;
    EXPECT_THAT(result.err, HasSubstr(word));
    EXPECT_FALSE(fs::exists(folder.path() / "b.db"));
    EXPECT_FALSE(fs::exists(folder.path() / "b.db.partial"));
  };
  expect({"no.db", "--out", "b.db"}, "does not exist");
  std::ofstream(folder.path() / "text.db") << "not a map";
  expect({"text.db", "--out", "b.db"}, "is not a map");
  expect({InputMap(), "--out", InputMap()}, "never changed");
  expect({InputMap(), "--out", "text.db/b.db"}, "cannot be written");
  std::ofstream(folder.path() / "a.yaml") << "processors: merge, nonsense\n";
  expect({InputMap(), "--out", "b.db", "--config", "a.yaml"}, "no map processor nonsense");
  std::ofstream(folder.path() / "b.yaml") << "pose_graf:\n  iterations: 3\n";
  expect({InputMap(), "--out", "b.db", "--config", "b.yaml"}, "pose_graf");
  expect({InputMap(), "--out", "b.db", "--model", "nowhere"}, "nowhere");
}

// The same session again and again: it is found in the first one, keyframe by keyframe.
TEST(MergeCommand, JoinsFurtherSessions) {
  const TemporaryFolder folder;
  const std::string before = ReadText(InputMap());
  for (int sessions = 2; sessions <= 3; ++sessions) {
    std::vector<std::string> arguments = {"merge", "--out", "c.db", "--report", "r.json"};
    arguments.insert(arguments.begin() + 1, static_cast<std::size_t>(sessions), InputMap());
    const ProgramResult result = RunProgram(folder.path(), arguments);
    ASSERT_EQ(result.exit_code, 0) << result.err;
    EXPECT_EQ(ReadText(InputMap()), before);
    const Map input = ReadMap(InputMap()), joined = ReadMap(folder.path() / "c.db");
    const std::size_t count = input.keyframes.size();
    ASSERT_EQ(joined.keyframes.size(), sessions * count);
    for (const auto& [id, keyframe] : joined.keyframes) {
      EXPECT_EQ(keyframe.component, 0);
      const Keyframe& original = joined.keyframes.at(id % static_cast<KeyframeId>(count));
      EXPECT_LT((keyframe.world_from_cam.translation - original.world_from_cam.translation).norm(),
                0.03);
    }
    const nlohmann::json report = nlohmann::json::parse(ReadText(folder.path() / "r.json"));
    EXPECT_EQ(report["maps"].size(), static_cast<std::size_t>(sessions));
  }
}

TEST(MergeCommand, NeedsTwoMaps) {
  const TemporaryFolder folder;
  const ProgramResult result = RunProgram(folder.path(), {"merge", InputMap(), "--out", "c.db"});
  EXPECT_EQ(result.exit_code, 2);
  EXPECT_THAT(result.err, HasSubstr("2"));
}

TEST(MergeCommand, RefusesSessionsOfOtherPlaces) {
  const TemporaryFolder folder;
  SyntheticSequenceOptions options;
  options.frames = 4;
  options.world.seed = 77;
  WriteEurocFolder(SyntheticSequence(options), folder.path() / "other");
  ASSERT_EQ(RunProgram(folder.path(), {"map", "other", "--out", "other_map"}).exit_code, 0);
  const ProgramResult result =
      RunProgram(folder.path(), {"merge", InputMap(), "other_map", "--out", "c.db"});
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_THAT(result.err, HasSubstr("cannot be joined"));
  EXPECT_FALSE(fs::exists(folder.path() / "c.db"));
}

}  // namespace
}  // namespace airslam
