// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/map/ply_export.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "airslam/common/error.h"
#include "airslam/map/test_scene.h"
#include "airslam/sensor/temporary_folder.h"

namespace airslam {
namespace {

// What a PLY file holds, read by its header's word.
struct PlyContent {
  std::vector<std::vector<double>> vertices, edges;
};

PlyContent ReadPly(const std::filesystem::path& file) {
  std::ifstream stream(file);
  std::string line;
  std::getline(stream, line);
  EXPECT_EQ(line, "ply");
  std::getline(stream, line);
  EXPECT_EQ(line, "format ascii 1.0");
  struct Element {
    std::string name;
    int count = 0, properties = 0;
  };
  std::vector<Element> elements;
  while (std::getline(stream, line) && line != "end_header") {
    std::istringstream words(line);
    std::string word, name;
    words >> word >> name;
    if (word == "element") {
      elements.push_back({name, 0, 0});
      words >> elements.back().count;
    }
    if (word == "property") ++elements.back().properties;
  }
  PlyContent content;
  for (const Element& element : elements) {
    for (int i = 0; i < element.count; ++i) {
      EXPECT_TRUE(std::getline(stream, line)) << element.name << i;
      std::istringstream words(line);
      std::vector<double> row;
      for (double value = 0; words >> value;) row.push_back(value);
      EXPECT_EQ(static_cast<int>(row.size()), element.properties) << line;
      (element.name == "edge" ? content.edges : content.vertices).push_back(row);
    }
  }
  EXPECT_FALSE(std::getline(stream, line)) << "nothing follows";
  return content;
}

TEST(PlyExport, HoldsPointsAndThePath) {
  const TemporaryFolder folder;
  const Map map = TestScene();
  WritePly(map, 0, folder.path() / "map.ply");
  const PlyContent ply = ReadPly(folder.path() / "map.ply");
  ASSERT_EQ(ply.vertices.size(), 12u + 3u);
  for (int i = 0; i < 12; ++i) {
    const Eigen::Vector3d& p = map.landmarks.at(i).point_in_world;
    for (int k = 0; k < 3; ++k) EXPECT_NEAR(ply.vertices[i][k], p[k], 1e-6);
  }
  // The cameras, each joined to the one before.
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(ply.vertices[12 + i][0], 0.1 * i, 1e-6);
    EXPECT_NEAR(ply.vertices[12 + i][2], 0.05 * i, 1e-6);
  }
  using ::testing::ElementsAre;
  EXPECT_THAT(ply.edges, ElementsAre(ElementsAre(12, 13), ElementsAre(13, 14)));
}

TEST(PlyExport, LinesAreEdges) {
  const TemporaryFolder folder;
  Map map = TestScene();
  map.line_landmarks[3] = {3, {{1, 2, 3}, {4, 5, 6}}, 0};
  map.line_landmarks[5] = {5, {{1, 2, 3}, {1, 5, 6}}, 2};
  map.keyframes[2].component = 1;
  WritePly(map, 0, folder.path() / "map.ply");
  const PlyContent ply = ReadPly(folder.path() / "map.ply");
  ASSERT_EQ(ply.vertices.size(), 12u + 2u + 2u);
  EXPECT_EQ(ply.vertices[13][2], 6);
  EXPECT_EQ(ply.edges.front(), (std::vector<double>{12, 13}));
}

TEST(PlyExport, LeavesOtherComponentsOut) {
  const TemporaryFolder folder;
  Map map = TestScene();
  map.keyframes[0].component = 1;  // and with it all points
  WritePly(map, 0, folder.path() / "map.ply");
  const PlyContent ply = ReadPly(folder.path() / "map.ply");
  EXPECT_EQ(ply.vertices.size(), 2u);
  EXPECT_EQ(ply.edges.size(), 1u);
}

TEST(PlyExport, SaysWhenItCannotWrite) {
  const TemporaryFolder folder;
  EXPECT_THROW(WritePly(TestScene(), 0, folder.path()), Error);
}

}  // namespace
}  // namespace airslam
