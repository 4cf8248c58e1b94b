// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/refine/join_maps.h"

#include <gtest/gtest.h>

#include "airslam/common/error.h"
#include "airslam/geometry/so3.h"
#include "airslam/refine/test_refine.h"

namespace airslam {
namespace {

TEST(AppendMap, IdsFollowThoseOfTheFirst) {
  SyntheticMap a = DriftingMap(), b = DriftingMap();
  b.map.line_landmarks[2] = {2, {{0, 0, 1}, {0, 1, 1}}, 3};
  const auto points = static_cast<LandmarkId>(a.map.landmarks.size());
  AppendMap(b.map, a.map, "a.db", "b.db");
  ASSERT_EQ(a.map.keyframes.size(), 50u);
  ASSERT_EQ(a.map.landmarks.size(), static_cast<std::size_t>(2 * points));
  EXPECT_EQ(a.map.line_landmarks.at(2).first_seen_by, 28);
  for (const auto& [id, keyframe] : b.map.keyframes) {
    const Keyframe& added = a.map.keyframes.at(id + 25);
    EXPECT_EQ(added.id, id + 25);
    EXPECT_EQ(added.component, 1);
    for (std::size_t i = 0; i < keyframe.landmarks.size(); ++i) {
      EXPECT_EQ(added.landmarks[i], keyframe.landmarks[i] + points);
    }
  }
  for (const auto& [id, landmark] : a.map.landmarks) {
    EXPECT_EQ(landmark.id, id);
    EXPECT_EQ(landmark.first_seen_by >= 25, id >= points);
  }
}

// The second session begins elsewhere in the hall, in a world of its own.
TEST(AppendMap, RefiningJoinsTheSessionsInTheFirstWorld) {
  SyntheticMap a = DriftingMap(0.005);
  SyntheticMapOptions options;
  options.keyframes = 15;
  options.seed = 1;  // the same building
  options.drift = 0.005;
  options.drift_angle = 0.0005;
  options.pixel_noise = 0.4;
  options.trajectory = SyntheticTrajectory::Loop(20, 2);
  SyntheticMap b = MakeSyntheticMap(options);
  std::map<KeyframeId, Rigid3> truth = a.true_world_from_cam;
  for (const auto& [id, pose] : b.true_world_from_cam) truth[id + 25] = pose;
  const Rigid3 other_world(ExpSO3({0, 0, 2}), {30, 4, 1});
  std::map<KeyframeId, Rigid3> moved;
  for (const auto& [id, keyframe] : b.map.keyframes) {
    moved[id] = other_world * keyframe.world_from_cam;
  }
  MoveKeyframes(moved, b.map);
  AppendMap(b.map, a.map, "a.db", "b.db");
  ASSERT_GT(KeyframeError(a.map, truth), 5);
  TestParts parts(a.map);
  RefineMap({}, parts.parts(), a.map);
  for (const auto& [id, keyframe] : a.map.keyframes) EXPECT_EQ(keyframe.component, 0) << id;
  EXPECT_LT(KeyframeError(a.map, truth), 0.15);
}

TEST(AppendMap, RefusesOtherCamerasAndOtherFeatures) {
  SyntheticMap a = DriftingMap(), b = DriftingMap();
  b.map.calibration.stereo.camera.fx += 1;
  EXPECT_THROW(AppendMap(b.map, a.map, "a.db", "b.db"), Error);
  b = DriftingMap();
  b.map.model_pack_sha256 = std::string(64, '1');
  EXPECT_THROW(AppendMap(b.map, a.map, "a.db", "b.db"), Error);
  EXPECT_EQ(a.map.keyframes.size(), 25u);
}

}  // namespace
}  // namespace airslam
