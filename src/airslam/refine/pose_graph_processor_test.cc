// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/refine/pose_graph_processor.h"

#include <gtest/gtest.h>

#include "airslam/refine/test_refine.h"

namespace airslam {
namespace {

// A true loop, known beforehand.
Loop TrueLoop(const SyntheticMap& made, KeyframeId earlier, KeyframeId later) {
  Loop loop;
  loop.earlier = earlier;
  loop.later = later;
  loop.earlier_from_later =
      made.true_world_from_cam.at(earlier).Inverse() * made.true_world_from_cam.at(later);
  loop.covariance = 1e-5 * Matrix6d::Identity();
  return loop;
}

TEST(PoseGraphProcessor, TakesDriftAwayAndLandmarksAlong) {
  SyntheticMap made = DriftingMap(0.02);
  const double before = KeyframeError(made.map, made.true_world_from_cam);
  ASSERT_GT(before, 0.2);
  const Map input = made.map;
  const RefineOptions options;
  RefineContext context{options};
  context.odometry = CollectOdometry(made.map);
  context.loops = {TrueLoop(made, 0, 20), TrueLoop(made, 4, 24)};
  PoseGraphProcessor().Process(made.map, context);
  EXPECT_LT(KeyframeError(made.map, made.true_world_from_cam), before);
  // Where the loop ends little is left; between, only bundle adjustment knows more.
  const auto error = [&](const Map& map, KeyframeId id) {
    return (map.keyframes.at(id).world_from_cam.translation -
            made.true_world_from_cam.at(id).translation)
        .norm();
  };
  for (KeyframeId id : {20, 24}) EXPECT_LT(error(made.map, id), 0.4 * error(input, id)) << id;
  EXPECT_EQ(made.map.keyframes.at(0).world_from_cam.translation,
            input.keyframes.at(0).world_from_cam.translation);
  for (const auto& [id, landmark] : made.map.landmarks) {
    const Rigid3& now = made.map.keyframes.at(landmark.first_seen_by).world_from_cam;
    const Rigid3& then = input.keyframes.at(landmark.first_seen_by).world_from_cam;
    EXPECT_LT((now.Inverse() * landmark.point_in_world -
               then.Inverse() * input.landmarks.at(id).point_in_world)
                  .norm(),
              1e-9);
  }
  EXPECT_GT(context.report["largest_move_m"].get<double>(), 0.1);
}

TEST(PoseGraphProcessor, DoesNothingWithoutLoopsOrInASmallMap) {
  SyntheticMap made = DriftingMap();
  const Map input = made.map;
  RefineOptions options;
  options.pose_graph.min_landmarks = 80000;
  RefineContext context{options};
  context.odometry = CollectOdometry(made.map);
  PoseGraphProcessor().Process(made.map, context);
  EXPECT_EQ(context.report["skipped"], "no loops");
  context.loops = {TrueLoop(made, 0, 20)};
  PoseGraphProcessor().Process(made.map, context);
  EXPECT_EQ(context.report["skipped"], "fewer landmarks than pose_graph.min_landmarks");
  for (const auto& [id, keyframe] : made.map.keyframes) {
    EXPECT_EQ(keyframe.world_from_cam.translation,
              input.keyframes.at(id).world_from_cam.translation);
  }
}

}  // namespace
}  // namespace airslam
