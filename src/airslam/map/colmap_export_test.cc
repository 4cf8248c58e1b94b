// SPDX-License-Identifier: BSD-3-Clause
//
// The text is checked against COLMAP's description of it; app/export_command_test.cc asks pycolmap.
#include "airslam/map/colmap_export.h"

#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "airslam/common/error.h"
#include "airslam/map/test_scene.h"
#include "airslam/sensor/temporary_folder.h"

namespace airslam {
namespace {

// The words of every line but comments.
std::vector<std::vector<std::string>> ReadRows(const std::filesystem::path& file) {
  std::ifstream stream(file);
  std::vector<std::vector<std::string>> rows;
  for (std::string line; std::getline(stream, line);) {
    if (line.starts_with('#')) continue;
    std::istringstream words(line);
    rows.emplace_back();
    for (std::string word; words >> word;) rows.back().push_back(word);
  }
  return rows;
}

class ColmapExport : public ::testing::Test {
 protected:
  void Write(const Map& map, int component = 0) {
    WriteColmap(map, component, folder_.path() / "model");
    cameras_ = ReadRows(folder_.path() / "model" / "cameras.txt");
    images_ = ReadRows(folder_.path() / "model" / "images.txt");
    points_ = ReadRows(folder_.path() / "model" / "points3D.txt");
  }
  TemporaryFolder folder_;
  std::vector<std::vector<std::string>> cameras_, images_, points_;
};

TEST_F(ColmapExport, CameraHasItsPrincipalPointFromThePixelsCorner) {
  Write(TestScene());
  ASSERT_EQ(cameras_.size(), 1u);
  EXPECT_EQ(cameras_[0], (std::vector<std::string>{"1", "PINHOLE", "640", "480", "400", "410",
                                                   "320.5", "240.5"}));
}

// Projects every point by COLMAP's own rules, with nothing but what the files say.
TEST_F(ColmapExport, PointsProjectOntoTheirObservations) {
  const Map map = TestScene();
  Write(map);
  ASSERT_EQ(images_.size(), 6u);
  std::map<std::string, Eigen::Vector3d> points;
  for (const auto& row : points_) {
    points[row[0]] = {std::stod(row[1]), std::stod(row[2]), std::stod(row[3])};
  }
  int seen = 0;
  for (std::size_t i = 0; i < images_.size(); i += 2) {
    const std::vector<std::string>& pose = images_[i];
    ASSERT_EQ(pose.size(), 10u);
    EXPECT_EQ(pose[0], std::to_string(i / 2 + 1));
    EXPECT_EQ(pose[8], "1");
    EXPECT_EQ(pose[9], fmt::format("{}.png", map.keyframes.at(i / 2).timestamp_ns));
    const Eigen::Quaterniond q(std::stod(pose[1]), std::stod(pose[2]), std::stod(pose[3]),
                               std::stod(pose[4]));
    const Eigen::Vector3d t(std::stod(pose[5]), std::stod(pose[6]), std::stod(pose[7]));
    const std::vector<std::string>& keypoints = images_[i + 1];
    ASSERT_EQ(keypoints.size(), 3 * 12u);
    for (std::size_t k = 0; k < keypoints.size(); k += 3, ++seen) {
      const Eigen::Vector3d p = q * points.at(keypoints[k + 2]) + t;
      EXPECT_NEAR(400 * p.x() / p.z() + 320.5, std::stod(keypoints[k]), 2e-3);
      EXPECT_NEAR(410 * p.y() / p.z() + 240.5, std::stod(keypoints[k + 1]), 2e-3);
    }
  }
  EXPECT_EQ(seen, 36);
}

TEST_F(ColmapExport, TracksAndKeypointsNameEachOther) {
  Map map = TestScene();
  map.keyframes[1].landmarks[3] = kNoLandmark;
  map.keyframes[2].landmarks[5] = 4;   // names landmark 4 twice
  map.keyframes[0].landmarks[7] = 99;  // was removed
  Write(map);
  int elements = 0;
  for (const auto& row : points_) {
    ASSERT_EQ(row.size() % 2, 0u);
    for (std::size_t k = 8; k < row.size(); k += 2, ++elements) {
      const int image = std::stoi(row[k]), index = std::stoi(row[k + 1]);
      EXPECT_EQ(images_[2 * (image - 1) + 1][3 * index + 2], row[0]);
    }
  }
  int named = 0;
  for (std::size_t i = 1; i < images_.size(); i += 2) {
    for (std::size_t k = 2; k < images_[i].size(); k += 3) named += images_[i][k] != "-1";
  }
  EXPECT_EQ(named, 36 - 3);
  EXPECT_EQ(elements, named);
}

TEST_F(ColmapExport, LeavesOtherComponentsOut) {
  Map map = TestScene();
  map.keyframes[2].component = 1;
  Write(map, 1);
  EXPECT_EQ(images_.size(), 2u);
  for (const auto& row : points_) EXPECT_EQ(row.size(), 8u + 2u);
}

TEST_F(ColmapExport, SaysWhenItCannotWrite) {
  std::ofstream(folder_.path() / "file") << "x";
  EXPECT_THROW(WriteColmap(TestScene(), 0, folder_.path() / "file"), Error);
}

}  // namespace
}  // namespace airslam
