// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/refine/map_tools.h"

#include <gtest/gtest.h>

#include "airslam/geometry/so3.h"
#include "airslam/map/test_scene.h"

namespace airslam {
namespace {

TEST(MapTools, ObservationsComeInOrderAndCountOnce) {
  Map map = TestScene();
  map.keyframes.at(1).landmarks[4] = 3;  // names 3 twice
  map.keyframes.at(2).landmarks[0] = kNoLandmark;
  const auto seen = CollectObservations(map);
  ASSERT_EQ(seen.at(3).size(), 3u);
  EXPECT_EQ(seen.at(3)[1].keyframe, 1);
  EXPECT_EQ(seen.at(3)[1].index, 3);
  EXPECT_EQ(seen.at(0).size(), 2u);
  EXPECT_EQ(seen.at(4).size(), 2u);
}

TEST(MapTools, LandmarksAndVelocitiesMoveAlong) {
  Map map = TestScene();
  map.landmarks.at(5).first_seen_by = 2;
  map.line_landmarks[1] = {1, {{1, 0, 5}, {2, 0, 5}}, 2};
  map.keyframes.at(2).velocity_in_world = {1, 0, 0};
  const Map before = map;
  const Rigid3 change(ExpSO3({0.1, 0.2, 0.3}), {1, 2, 3});
  MoveKeyframes({{2, change * map.keyframes.at(2).world_from_cam}}, map);
  EXPECT_LT(
      (map.landmarks.at(5).point_in_world - change * before.landmarks.at(5).point_in_world).norm(),
      1e-12);
  EXPECT_EQ(map.landmarks.at(4).point_in_world, before.landmarks.at(4).point_in_world);
  EXPECT_LT((map.line_landmarks.at(1).ends_in_world.end - change * Eigen::Vector3d(2, 0, 5)).norm(),
            1e-12);
  EXPECT_LT(
      (map.keyframes.at(2).velocity_in_world - change.rotation * Eigen::Vector3d::UnitX()).norm(),
      1e-12);
}

TEST(MapTools, UnseenLandmarksGo) {
  Map map = TestScene();
  for (auto& [id, keyframe] : map.keyframes) keyframe.landmarks[2] = kNoLandmark;
  map.line_landmarks[1] = {1, {{1, 0, 5}, {2, 0, 5}}, 2};
  EXPECT_EQ(RemoveUnseenLandmarks(map), 1);
  EXPECT_FALSE(map.landmarks.contains(2));
  EXPECT_TRUE(map.line_landmarks.empty());
}

TEST(MapTools, ErrorsArePixels) {
  Map map = TestScene();
  map.keyframes.at(2).component = 1;
  const MapErrors exact = MeasureErrors(map);
  EXPECT_EQ(exact.keyframes, 3);
  EXPECT_EQ(exact.components, 2);
  EXPECT_EQ(exact.landmarks, 12);
  EXPECT_EQ(exact.observations, 36);
  EXPECT_LT(exact.rms_error, 1e-3);
  for (auto& [id, keyframe] : map.keyframes) {
    for (Keypoint& keypoint : keyframe.keypoints) keypoint.x += 2;
  }
  EXPECT_NEAR(MeasureErrors(map).rms_error, 2, 1e-3);
  EXPECT_NEAR(MeasureErrors(map).median_error, 2, 1e-3);
}

}  // namespace
}  // namespace airslam
