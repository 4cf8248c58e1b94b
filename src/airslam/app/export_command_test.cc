// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "airslam/app/test_dataset.h"
#include "airslam/dataset/trajectory.h"
#include "airslam/map/map_file.h"

namespace airslam {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::SizeIs;

ProgramResult Export(const TemporaryFolder& folder, std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), {"export", TestDataset::Get().result().string()});
  return RunProgram(folder.path(), arguments);
}

TEST(ExportCommand, TumIsWhatMapWrote) {
  const TemporaryFolder folder;
  const ProgramResult result = Export(folder, {"--tum", "keyframes.tum"});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(ReadText(folder.path() / "keyframes.tum"),
            ReadText(TestDataset::Get().result() / "keyframes.tum"));
}

TEST(ExportCommand, WritesAllThreeAtOnce) {
  const TemporaryFolder folder;
  const ProgramResult result =
      Export(folder, {"--tum", "a.tum", "--ply", "a.ply", "--colmap", "sparse/0"});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_THAT(ReadText(folder.path() / "a.ply"), HasSubstr("element edge"));
  for (const char* name : {"cameras.txt", "images.txt", "points3D.txt"}) {
    EXPECT_TRUE(fs::exists(folder.path() / "sparse/0" / name)) << name;
  }
}

// Needs pycolmap in .venv.
TEST(ExportCommand, PycolmapLoadsTheModel) {
  const fs::path python = fs::path(AIRSLAM_SOURCE_DIR) / ".venv/bin/python";
  if (std::system((python.string() + " -c 'import pycolmap' 2>/dev/null").c_str()) != 0) {
    GTEST_SKIP() << "pycolmap is not installed in .venv";
  }
  const TemporaryFolder folder;
  ASSERT_EQ(Export(folder, {"--colmap", "model"}).exit_code, 0);
  std::ofstream(folder.path() / "check.py") << R"(
import sys, pycolmap
model = pycolmap.Reconstruction(sys.argv[1])
errors = [point.error for point in model.points3D.values()]
print(model.num_images(), model.num_points3D(), model.compute_num_observations())
assert model.compute_mean_reprojection_error() < 2, model.compute_mean_reprojection_error()
)";
  const std::string command = python.string() + " " + (folder.path() / "check.py").string() + " " +
                              (folder.path() / "model").string() + " > " +
                              (folder.path() / "counts").string();
  ASSERT_EQ(std::system(command.c_str()), 0);
  const Map map = ReadMap(TestDataset::Get().result() / "map.db");
  EXPECT_THAT(ReadText(folder.path() / "counts"),
              HasSubstr(fmt::format("{} {} ", map.keyframes.size(), map.landmarks.size())));
}

TEST(ExportCommand, SaysWhatIsWrongInOneSentence) {
  const TemporaryFolder folder;
  const auto expect = [&](const std::vector<std::string>& arguments, const std::string& word) {
    const ProgramResult result = RunProgram(folder.path(), arguments);
    EXPECT_EQ(result.exit_code, 1);
    EXPECT_THAT(result.Complaints(), SizeIs(1)) << result.err;
    EXPECT_THAT(result.err, HasSubstr(word));
  };
  const std::string map = TestDataset::Get().result().string();
  expect({"export", map}, "what to write: tum, ply or colmap");
  expect({"export", "no.db", "--tum", "a.tum"}, "does not exist");
  expect({"export", map, "--ply", "a.ply", "--component", "7"}, "no component 7");
  expect({"export", map, "--ply", folder.path().string()}, "is a folder");
}

}  // namespace
}  // namespace airslam
