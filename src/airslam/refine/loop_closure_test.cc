// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/refine/loop_closure.h"

#include <gtest/gtest.h>

#include "airslam/refine/test_refine.h"

namespace airslam {
namespace {

TEST(LoopClosure, FindsThePlacesThatAreSeenAgainAndNoOther) {
  SyntheticMap made = DriftingMap();
  const Map before = made.map;
  TestParts parts(made.map);
  const RefineOptions options;
  RefineContext context = parts.context(options, made.map);
  LoopClosure().Process(made.map, context);
  std::set<KeyframeId> found;
  for (const Loop& loop : context.loops) {
    found.insert(loop.later);
    EXPECT_LT(loop.earlier, loop.later);
    EXPECT_GT(loop.inliers, options.loop_closure.min_inliers);
    EXPECT_EQ(loop.keypoints.size(), static_cast<std::size_t>(loop.inliers));
    // The landmarks of a keyframe have drifted, too, since their own first keyframes.
    EXPECT_LT(LoopError(loop, made), 0.1) << loop.earlier << " " << loop.later;
    // Matched keypoints are the same point of the world.
    int wrong = 0;
    for (const auto& [i, j] : loop.keypoints) {
      const LandmarkId a = made.map.keyframes.at(loop.earlier).landmarks[i];
      const LandmarkId b = made.map.keyframes.at(loop.later).landmarks[j];
      wrong += made.point_of_landmark.at(a) != made.point_of_landmark.at(b);
    }
    EXPECT_EQ(wrong, 0);
  }
  for (KeyframeId id = 20; id < 25; ++id) EXPECT_TRUE(found.contains(id)) << id;
  EXPECT_EQ(context.report["loops"].size(), context.loops.size());
  for (const auto& [id, keyframe] : made.map.keyframes) {
    EXPECT_EQ(keyframe.world_from_cam.translation,
              before.keyframes.at(id).world_from_cam.translation)
        << "it only finds";
  }
}

TEST(LoopClosure, RefusesWhatOdometryCannotHaveDrifted) {
  SyntheticMap made = DriftingMap();
  // The last five keyframes stand 4 m away: as a second place that looks the same would.
  std::map<KeyframeId, Rigid3> poses;
  for (KeyframeId id = 20; id < 25; ++id) {
    poses[id] = Rigid3(Eigen::Quaterniond::Identity(), {4, 0, 0}) *
                made.map.keyframes.at(id).world_from_cam;
  }
  MoveKeyframes(poses, made.map);
  TestParts parts(made.map);
  const RefineOptions options;
  RefineContext context = parts.context(options, made.map);
  LoopClosure().Process(made.map, context);
  for (const Loop& loop : context.loops) EXPECT_LT(loop.later, 20);
  EXPECT_GT(context.report["refused"].value("further than odometry drifts", 0), 0);
}

// Tracking was lost after the round trip: the last keyframes are a component with a world of its
// own.
SyntheticMap Interrupted() {
  SyntheticMap made = DriftingMap(0.002);
  const Rigid3 other_world(Eigen::Quaterniond(Eigen::AngleAxisd(1, Eigen::Vector3d::UnitZ())),
                           {10, -5, 0.5});
  std::map<KeyframeId, Rigid3> poses;
  for (KeyframeId id = 20; id < 25; ++id) {
    Keyframe& keyframe = made.map.keyframes.at(id);
    keyframe.component = 1;
    keyframe.velocity_in_world = {1, 0, 0};
    poses[id] = other_world * keyframe.world_from_cam;
  }
  MoveKeyframes(poses, made.map);
  // Nor does it share landmarks with what was before.
  for (LandmarkId& id : made.map.keyframes.at(20).landmarks) {
    if (id != kNoLandmark && made.map.landmarks.at(id).first_seen_by < 20) id = kNoLandmark;
  }
  for (KeyframeId k = 21; k < 25; ++k) {
    for (LandmarkId& id : made.map.keyframes.at(k).landmarks) {
      if (id != kNoLandmark && made.map.landmarks.at(id).first_seen_by < 20) id = kNoLandmark;
    }
  }
  return made;
}

TEST(LoopClosure, JoinsComponents) {
  SyntheticMap made = Interrupted();
  ASSERT_GT(KeyframeError(made.map, made.true_world_from_cam), 1);
  TestParts parts(made.map);
  const RefineOptions options;
  RefineContext context = parts.context(options, made.map);
  LoopClosure().Process(made.map, context);
  EXPECT_EQ(context.report["components_joined"], 1);
  for (const auto& [id, keyframe] : made.map.keyframes) EXPECT_EQ(keyframe.component, 0) << id;
  EXPECT_LT(KeyframeError(made.map, made.true_world_from_cam), 0.2);
  EXPECT_LT((made.map.keyframes.at(22).velocity_in_world - Eigen::Vector3d(1, 0, 0)).norm(), 0.1)
      << "velocities turn too";
}

TEST(LoopClosure, LeavesComponentsApartWhenTooFewLoopsAgree) {
  SyntheticMap made = Interrupted();
  TestParts parts(made.map);
  RefineOptions options;
  options.loop_closure.min_joining_loops = 40;
  RefineContext context = parts.context(options, made.map);
  LoopClosure().Process(made.map, context);
  EXPECT_EQ(context.report["components_joined"], 0);
  EXPECT_EQ(made.map.keyframes.at(22).component, 1);
  for (const Loop& loop : context.loops) EXPECT_LT(loop.later, 20);
}

TEST(LoopClosure, SaysThatItCannotWithoutNetworks) {
  SyntheticMap made = DriftingMap();
  const RefineOptions options;
  RefineContext context{options};
  LoopClosure().Process(made.map, context);
  EXPECT_TRUE(context.report.contains("skipped"));
}

}  // namespace
}  // namespace airslam
