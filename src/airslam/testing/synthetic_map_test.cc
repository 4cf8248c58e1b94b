// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/testing/synthetic_map.h"

#include <gtest/gtest.h>

#include <set>

#include "airslam/map/covisibility.h"

namespace airslam {
namespace {

TEST(SyntheticMap, WithoutDriftItIsConsistent) {
  const SyntheticMap made = MakeSyntheticMap({});
  EXPECT_EQ(made.map.keyframes.size(), 24u);
  EXPECT_LT(KeyframeError(made.map, made.true_world_from_cam), 1e-9);
  int observations = 0;
  for (const auto& [id, keyframe] : made.map.keyframes) {
    EXPECT_GT(keyframe.keypoints.size(), 60u) << id;
    for (std::size_t i = 0; i < keyframe.landmarks.size(); ++i, ++observations) {
      const Eigen::Vector3d p = keyframe.world_from_cam.Inverse() *
                                made.map.landmarks.at(keyframe.landmarks[i]).point_in_world;
      const Eigen::Vector2d pixel = made.map.calibration.stereo.camera.Project(p);
      // Both the landmark and the keypoint have noise.
      EXPECT_LT((pixel - Eigen::Vector2d(keyframe.keypoints[i].x, keyframe.keypoints[i].y)).norm(),
                4)
          << id;
    }
  }
  EXPECT_GT(observations, 2000);
}

TEST(SyntheticMap, APlaceThatIsSeenAgainHasNewLandmarks) {
  const SyntheticMap made = MakeSyntheticMap({});
  const CovisibilityGraph graph = CountCovisibility(made.map);
  // The round trip takes 20 keyframes: 20 stands where 0 stood.
  const Rigid3 apart = made.true_world_from_cam.at(0).Inverse() * made.true_world_from_cam.at(20);
  EXPECT_LT(apart.translation.norm(), 1e-6);
  EXPECT_FALSE(graph.at(20).contains(0));
  EXPECT_GT(graph.at(20).at(19), 20);
  std::set<int> first, again;
  for (LandmarkId id : made.map.keyframes.at(0).landmarks) {
    first.insert(made.point_of_landmark.at(id));
  }
  for (LandmarkId id : made.map.keyframes.at(20).landmarks) {
    again.insert(made.point_of_landmark.at(id));
  }
  EXPECT_EQ(first, again);
}

TEST(SyntheticMap, DriftsAndRepeats) {
  SyntheticMapOptions options;
  options.drift = 0.01;
  options.drift_angle = 0.002;
  const SyntheticMap a = MakeSyntheticMap(options), b = MakeSyntheticMap(options);
  EXPECT_GT(KeyframeError(a.map, a.true_world_from_cam), 0.05);
  for (const auto& [id, keyframe] : a.map.keyframes) {
    EXPECT_EQ(keyframe.world_from_cam.translation,
              b.map.keyframes.at(id).world_from_cam.translation);
    EXPECT_EQ(keyframe.descriptors, b.map.keyframes.at(id).descriptors);
  }
}

TEST(SyntheticMap, CopiesStandApart) {
  SyntheticMapOptions options;
  options.copies = 2;
  options.keyframes = 3;
  const SyntheticMap made = MakeSyntheticMap(options);
  ASSERT_EQ(made.map.keyframes.size(), 6u);
  EXPECT_NEAR(
      (made.true_world_from_cam.at(3).translation - made.true_world_from_cam.at(0).translation)
          .norm(),
      25, 1e-9);
  EXPECT_FALSE(CountCovisibility(made.map).at(3).contains(2));
}

}  // namespace
}  // namespace airslam
