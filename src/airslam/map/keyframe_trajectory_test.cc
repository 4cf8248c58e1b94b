// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/map/keyframe_trajectory.h"

#include <gtest/gtest.h>

#include "airslam/map/test_scene.h"

namespace airslam {
namespace {

TEST(KeyframeTrajectory, IsTheBodysInOrderOfTime) {
  Map map = TestScene();
  map.keyframes[2].timestamp_ns -= 1'000'000'000;  // as after joining an earlier session
  const Trajectory trajectory = MapTrajectory(map, 0);
  ASSERT_EQ(trajectory.size(), 3u);
  EXPECT_EQ(trajectory[0].timestamp_ns, map.keyframes[2].timestamp_ns);
  const Rigid3 world_from_body =
      map.keyframes[1].world_from_cam * map.calibration.body_from_left.Inverse();
  EXPECT_LT((trajectory[2].world_from_body.ToMatrix() - world_from_body.ToMatrix()).norm(), 1e-12);
}

TEST(KeyframeTrajectory, LargestComponent) {
  EXPECT_EQ(LargestMapComponent(Map()), -1);
  Map map = TestScene();
  EXPECT_EQ(LargestMapComponent(map), 0);
  map.keyframes[1].component = map.keyframes[2].component = 4;
  EXPECT_EQ(LargestMapComponent(map), 4);
  EXPECT_EQ(MapTrajectory(map, 0).size(), 1u);
  map.keyframes.erase(2);
  EXPECT_EQ(LargestMapComponent(map), 0) << "the smaller of equals";
}

}  // namespace
}  // namespace airslam
