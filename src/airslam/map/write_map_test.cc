// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/map/write_map.h"

#include <gtest/gtest.h>

#include <fstream>

#include "airslam/common/error.h"
#include "airslam/map/map_file.h"
#include "airslam/map/test_map.h"
#include "airslam/map/test_scene.h"
#include "airslam/sensor/temporary_folder.h"

namespace airslam {
namespace {

Map SceneWithLines() {
  Map map = TestScene();
  map.landmarks[5].first_seen_by = 2;
  map.line_landmarks[3] = {3, {{1, 2, 3}, {4, 5, 6}}, 1};
  map.keyframes[1].component = 1;
  map.keyframes[2].has_inertial_state = true;
  map.keyframes[2].velocity_in_world = {1, 2, 3};
  return map;
}

TEST(WriteMap, IsReadBack) {
  const TemporaryFolder folder;
  const Map map = SceneWithLines();
  PlaceRecord place;
  place.vocabulary_sha256 = std::string(64, 'a');
  for (const auto& [id, keyframe] : map.keyframes) {
    place.words[id].keypoints.assign(keyframe.keypoints.size(), 7);
    place.covisibility[id] = {};
  }
  WriteMap(map, place, folder.path() / "map.db");
  const Map read = ReadMap(folder.path() / "map.db");
  ASSERT_EQ(read.keyframes.size(), map.keyframes.size());
  for (const auto& [id, keyframe] : map.keyframes) {
    EXPECT_EQ(read.keyframes.at(id).landmarks, keyframe.landmarks);
    EXPECT_EQ(read.keyframes.at(id).right_x, keyframe.right_x);
    EXPECT_EQ(read.keyframes.at(id).component, keyframe.component);
    EXPECT_EQ(read.keyframes.at(id).world_from_cam.translation,
              keyframe.world_from_cam.translation);
  }
  EXPECT_EQ(read.keyframes.at(2).velocity_in_world, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(read.landmarks.at(5).first_seen_by, 2);
  EXPECT_EQ(read.line_landmarks.at(3).ends_in_world.end, Eigen::Vector3d(4, 5, 6));
  const auto read_place = ReadPlaceRecord(folder.path() / "map.db");
  ASSERT_TRUE(read_place.has_value());
  EXPECT_EQ(read_place->words, place.words);
  EXPECT_FALSE(std::filesystem::exists(folder.path() / "map.db.partial"));
}

TEST(WriteMap, ReplacesAnEarlierOneOnlyAsAWhole) {
  const TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "map.db";
  WriteMap(TestScene(), {}, file);
  const std::string before = MapDigest(file);
  Map broken = TestScene();
  broken.keyframes[1].right_x.pop_back();
  EXPECT_THROW(WriteMap(broken, {}, file), Error);
  EXPECT_EQ(MapDigest(file), before);
  EXPECT_FALSE(std::filesystem::exists(file.string() + ".partial"));
  Map smaller = TestScene();
  smaller.keyframes.erase(2);
  WriteMap(smaller, {}, file);
  EXPECT_EQ(ReadMap(file).keyframes.size(), 2u);
}

}  // namespace
}  // namespace airslam
