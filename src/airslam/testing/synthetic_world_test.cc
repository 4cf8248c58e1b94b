// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/testing/synthetic_world.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "airslam/testing/synthetic_motion.h"
#include "airslam/testing/synthetic_rig.h"

namespace airslam {
namespace {

// The left camera's pose of a rig that follows a trajectory, two seconds after its start.
Rigid3 CameraPose(const StereoRig& rig) {
  SyntheticTrajectory trajectory = SyntheticTrajectory::Loop();
  trajectory.Mount(HeadingFromBody(rig), 0);
  return trajectory.At(2'000'000'000).world_from_body * rig.left.body_from_cam;
}

TEST(SyntheticWorldTest, IsTheSameForTheSameSeedAndAnotherForAnother) {
  const SyntheticWorld first({.seed = 3}), second({.seed = 3}), other({.seed = 4});
  ASSERT_EQ(first.points().size(), second.points().size());
  for (std::size_t i = 0; i < first.points().size(); ++i) {
    EXPECT_EQ(first.points()[i], second.points()[i]);
  }
  EXPECT_NE(first.boxes()[1].half_size, other.boxes()[1].half_size);
}

TEST(SyntheticWorldTest, RayMeetsTheNearFaceOfABoxAndTheWallBesideIt) {
  WorldBox box;
  box.centre = {2, 0, 1};
  box.half_size = {0.5, 0.5, 1};
  const Eigen::Vector3d eye(0, 0.25, 1), forward(2, 0, 0);
  const auto hit = CastBox(box, false, box.ToLocal(eye), box.DirectionToLocal(forward));
  ASSERT_TRUE(hit);
  EXPECT_NEAR(hit->distance, 0.75, 1e-12);  // in units of the direction's length
  EXPECT_EQ(hit->face, 0);
  EXPECT_NEAR(hit->u, 0.25, 1e-12);
  EXPECT_NEAR(hit->cosine, 1, 1e-12);
  EXPECT_FALSE(CastBox(box, false, box.ToLocal(eye), box.DirectionToLocal(-forward)));
  EXPECT_FALSE(CastBox(box, false, box.ToLocal({0, 0.6, 1}), box.DirectionToLocal(forward)));
  const auto wall = CastBox(box, true, Eigen::Vector3d::Zero(), {0, 1, 0});
  ASSERT_TRUE(wall);
  EXPECT_NEAR(wall->distance, 0.5, 1e-12);
  EXPECT_EQ(wall->face, 3);
}

TEST(SyntheticWorldTest, BoxFrameAndWorldFrameAreInverse) {
  WorldBox box;
  box.centre = {1, -2, 0.5};
  box.yaw = 0.7;
  const Eigen::Vector3d point(0.3, 0.8, -1.1);
  EXPECT_LT((box.ToWorld(box.ToLocal(point)) - point).norm(), 1e-12);
}

TEST(SyntheticWorldTest, PlacesOfTheTrajectoriesAreFree) {
  for (std::uint32_t seed = 1; seed <= 10; ++seed) {
    const SyntheticWorld world({.seed = seed});
    for (int i = 0; i < 64; ++i) {
      const double angle = i * 2 * std::numbers::pi / 64;
      const Eigen::Vector3d ring(2.6 * std::cos(angle), 2.6 * std::sin(angle), 1.4);
      const Eigen::Vector3d aisle(-6 + 12 * i / 63.0, -2.6, 1.4);
      const Eigen::Vector3d sideways(std::cos(angle), std::sin(angle), 0);
      EXPECT_GT(world.Cast(ring, sideways)->distance, 0.7) << "seed " << seed << " step " << i;
      EXPECT_GT(world.Cast(aisle, sideways)->distance, 0.5) << "seed " << seed << " step " << i;
    }
  }
}

TEST(SyntheticWorldTest, SeesManyPointsWhereTheyProject) {
  const SyntheticWorld world;
  for (const StereoRig& rig : {IdealRig(), EurocLikeRig()}) {
    const Rigid3 world_from_cam = CameraPose(rig);
    std::mt19937 random(1);
    const auto seen = ObservePoints(world, rig.left.camera, world_from_cam, 0, random);
    EXPECT_GT(seen.size(), 60u);
    for (const VisiblePoint& observation : seen) {
      Eigen::Vector3d ray;
      ASSERT_TRUE(rig.left.camera.Unproject(observation.pixel, &ray));
      const Eigen::Vector3d back = world_from_cam * Eigen::Vector3d(ray * observation.depth);
      EXPECT_LT((back - world.points()[observation.point]).norm(), 1e-6);
    }
  }
}

TEST(SyntheticWorldTest, PointsBehindABoxAreHidden) {
  const SyntheticWorld world;
  const WorldBox& crate = world.boxes()[17];
  const Eigen::Vector3d eye(2.6, 0, 0.3);
  const Eigen::Vector3d towards = crate.centre - eye;
  const auto hit = world.Cast(eye, towards);
  ASSERT_TRUE(hit);
  EXPECT_GT(hit->box, 0);
  EXPECT_TRUE(world.Visible(eye, eye + hit->distance * towards));
  EXPECT_FALSE(world.Visible(eye, eye + 1.5 * towards));
}

TEST(SyntheticWorldTest, PixelNoiseHasTheAskedSpread) {
  const SyntheticWorld world({.seed = 1, .num_points = 8000});
  const StereoRig rig = IdealRig();
  std::mt19937 random(5);
  const auto exact = ObservePoints(world, rig.left.camera, CameraPose(rig), 0, random);
  const auto noisy = ObservePoints(world, rig.left.camera, CameraPose(rig), 0.8, random);
  ASSERT_EQ(exact.size(), noisy.size());
  double sum = 0;
  for (std::size_t i = 0; i < exact.size(); ++i) {
    sum += (exact[i].pixel - noisy[i].pixel).squaredNorm();
  }
  EXPECT_NEAR(std::sqrt(sum / (2.0 * static_cast<double>(exact.size()))), 0.8, 0.08);
}

TEST(SyntheticWorldTest, SegmentsProjectOntoTheLineOfTheirEnds) {
  const SyntheticWorld world;
  const StereoRig rig = IdealRig();
  const Rigid3 world_from_cam = CameraPose(rig), cam_from_world = world_from_cam.Inverse();
  std::mt19937 random(1);
  const auto seen = ObserveSegments(world, rig.left.camera, world_from_cam, 0, 20, random);
  EXPECT_GT(seen.size(), 20u);
  for (const SegmentObservation& observation : seen) {
    const WorldSegment& segment = world.segments()[observation.segment];
    const Eigen::Vector3d axis = (segment.end - segment.start).normalized();
    EXPECT_LT((observation.start_in_world - segment.start).cross(axis).norm(), 1e-9);
    EXPECT_LT((observation.end_in_world - segment.start).cross(axis).norm(), 1e-9);
    EXPECT_GE((observation.end - observation.start).norm(), 20);
    EXPECT_LT((rig.left.camera.Project(cam_from_world * observation.end_in_world) - observation.end)
                  .norm(),
              1e-9);
    EXPECT_TRUE(world.Visible(world_from_cam.translation, observation.start_in_world));
  }
}

}  // namespace
}  // namespace airslam
