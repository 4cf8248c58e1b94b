// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/upright.h"

#include <gtest/gtest.h>

#include "airslam/geometry/so3.h"

namespace airslam {
namespace {

TEST(UprightFromWorld, TurnsGravityDown) {
  for (const Eigen::Vector3d& gravity :
       {Eigen::Vector3d(1, 9, -3), Eigen::Vector3d(0, 0, -9.81), Eigen::Vector3d(0, 0, 9.81)}) {
    const Eigen::Vector3d turned = UprightFromWorld(gravity) * gravity;
    EXPECT_LT((turned - Eigen::Vector3d(0, 0, -gravity.norm())).norm(), 1e-9);
  }
  EXPECT_LT(Rigid3(UprightFromWorld({0, 0, -1}), Eigen::Vector3d::Zero()).Angle(), 1e-9);
}

TEST(TurnComponent, TurnsAllOfItAndNothingElse) {
  Map map;
  std::vector<FrameRecord> records(2);
  for (int i : {0, 1}) {
    Keyframe keyframe;
    keyframe.id = keyframe.component = i;
    keyframe.world_from_cam = {ExpSO3({0.1, 0.2, 0.3}), {1, 2, 3}};
    keyframe.has_inertial_state = true;
    keyframe.velocity_in_world = {4, 5, 6};
    keyframe.gyroscope_bias = {7, 8, 9};
    map.keyframes[i] = keyframe;
    map.landmarks[i] = {i, {1, 1, 1}, i};
    map.line_landmarks[i] = {i, {{1, 0, 0}, {2, 3, 4}}, i};
    records[i].component = i;
    records[i].online_world_from_cam = keyframe.world_from_cam;
    records[i].reference_from_cam.translation = {1, 0, 0};
  }
  const Map before = map;
  const Eigen::Quaterniond turn = ExpSO3({0.5, -0.4, 0.9});
  const MapWriter::Update update = TurnComponent(turn, 1, map, records);

  const Rigid3 expected = Rigid3(turn, {0, 0, 0}) * before.keyframes.at(1).world_from_cam;
  EXPECT_LT((map.keyframes[1].world_from_cam.ToMatrix() - expected.ToMatrix()).norm(), 1e-12);
  EXPECT_LT((records[1].online_world_from_cam.ToMatrix() - expected.ToMatrix()).norm(), 1e-12);
  EXPECT_EQ(records[1].reference_from_cam.translation, Eigen::Vector3d(1, 0, 0));
  EXPECT_LT((map.keyframes[1].velocity_in_world - turn * Eigen::Vector3d(4, 5, 6)).norm(), 1e-12);
  EXPECT_EQ(map.keyframes[1].gyroscope_bias, Eigen::Vector3d(7, 8, 9));
  EXPECT_LT((map.landmarks[1].point_in_world - turn * Eigen::Vector3d(1, 1, 1)).norm(), 1e-12);
  EXPECT_EQ(map.keyframes[0].world_from_cam.ToMatrix(),
            before.keyframes.at(0).world_from_cam.ToMatrix());
  EXPECT_EQ(map.landmarks[0].point_in_world, Eigen::Vector3d(1, 1, 1));

  const SpaceSegment& line = map.line_landmarks[1].ends_in_world;
  EXPECT_LT((line.start - turn * Eigen::Vector3d(1, 0, 0)).norm(), 1e-12);
  EXPECT_LT((line.end - turn * Eigen::Vector3d(2, 3, 4)).norm(), 1e-12);
  EXPECT_EQ(map.line_landmarks[0].ends_in_world.end, Eigen::Vector3d(2, 3, 4));
  ASSERT_EQ(update.line_landmarks.size(), 1u);
  EXPECT_EQ(update.line_landmarks[0].ends_in_world.end, line.end);

  ASSERT_EQ(update.world_from_cam.size(), 1u);
  EXPECT_EQ(update.world_from_cam[0].first, 1);
  ASSERT_EQ(update.landmarks.size(), 1u);
  EXPECT_EQ(update.landmarks[0].point_in_world, map.landmarks[1].point_in_world);
  ASSERT_EQ(update.inertial_states.size(), 1u);
  EXPECT_EQ(update.inertial_states[0].velocity_in_world, map.keyframes[1].velocity_in_world);
}

}  // namespace
}  // namespace airslam
