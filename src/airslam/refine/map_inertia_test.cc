// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/refine/map_inertia.h"

#include <gtest/gtest.h>

#include "airslam/geometry/so3.h"
#include "airslam/refine/global_bundle.h"
#include "airslam/refine/test_refine.h"
#include "airslam/sensor/imu_buffer.h"
#include "airslam/testing/synthetic_rig.h"

namespace airslam {
namespace {

const Eigen::Vector3d kAccelerometerBias(0.05, -0.03, 0.02);

// A map with exact states and the readings between its keyframes.
SyntheticMap InertialMap(double drift) {
  SyntheticMap made = DriftingMap(drift);
  const StereoRig rig = IdealRig();
  SyntheticTrajectory motion = SyntheticTrajectory::Loop();
  const std::int64_t start = made.map.keyframes.at(0).timestamp_ns;
  const std::int64_t end = made.map.keyframes.rbegin()->second.timestamp_ns;
  motion.Mount(HeadingFromBody(rig), start);
  ImuSimulationOptions options;
  options.noise = *rig.imu;
  options.accelerometer_bias = kAccelerometerBias;
  const ImuBuffer buffer(SimulateImu(motion, start, end + 100'000'000, options).samples, {});
  std::int64_t previous = -1;
  for (auto& [id, keyframe] : made.map.keyframes) {
    keyframe.has_inertial_state = true;
    keyframe.velocity_in_world = motion.At(keyframe.timestamp_ns).velocity_in_world;
    keyframe.accelerometer_bias = kAccelerometerBias;
    if (previous >= 0) {
      keyframe.imu_samples = buffer.Between(previous, keyframe.timestamp_ns).samples;
      keyframe.imu_noise = *rig.imu;
    }
    previous = keyframe.timestamp_ns;
  }
  return made;
}

std::map<KeyframeId, int> Positions(const Map& map) {
  std::map<KeyframeId, int> positions;
  for (const auto& [id, keyframe] : map.keyframes) {
    positions.emplace(id, static_cast<int>(positions.size()));
  }
  return positions;
}

TEST(MapInertia, LinksKeyframesAndFindsGravityInAnyWorld) {
  SyntheticMap made = InertialMap(0);
  const Rigid3 turn(ExpSO3({0.4, -0.2, 0.3}), {1, 2, 3});
  std::map<KeyframeId, Rigid3> poses;
  for (const auto& [id, keyframe] : made.map.keyframes) poses[id] = turn * keyframe.world_from_cam;
  MoveKeyframes(poses, made.map);
  const InertialTerms terms = CollectInertialTerms(made.map, Positions(made.map));
  EXPECT_EQ(terms.states.size(), 25u);
  EXPECT_EQ(terms.links.size(), 24u);
  EXPECT_EQ(terms.priors.size(), 1u);
  const Eigen::Vector3d expected = turn.rotation * kGravityInWorld;
  EXPECT_LT((terms.gravity_in_world - expected).norm(), 0.02);
}

TEST(MapInertia, ARemovedKeyframeBreaksTheChain) {
  SyntheticMap made = InertialMap(0);
  made.map.keyframes.erase(10);
  const InertialTerms terms = CollectInertialTerms(made.map, Positions(made.map));
  EXPECT_EQ(terms.states.size(), 24u);
  EXPECT_EQ(terms.links.size(), 22u);
  EXPECT_EQ(terms.priors.size(), 2u);
}

TEST(MapInertia, AComponentOfAnotherGravityIsLeftOut) {
  SyntheticMap made = InertialMap(0);
  const Rigid3 turn(ExpSO3({0.4, 0, 0}), {0, 0, 0});
  std::map<KeyframeId, Rigid3> poses;
  for (KeyframeId id = 20; id < 25; ++id) {
    made.map.keyframes.at(id).component = 1;
    poses[id] = turn * made.map.keyframes.at(id).world_from_cam;
  }
  MoveKeyframes(poses, made.map);
  EXPECT_EQ(CollectInertialTerms(made.map, Positions(made.map)).states.size(), 20u);
}

TEST(MapInertia, WithoutReadingsThereIsNothing) {
  const SyntheticMap made = DriftingMap();
  EXPECT_TRUE(CollectInertialTerms(made.map, Positions(made.map)).links.empty());
}

// The global bundle keeps the IMU: biases and velocities come out right, poses no worse.
TEST(MapInertia, GlobalBundleUsesIt) {
  SyntheticMap made = InertialMap(0.002);
  for (auto& [id, keyframe] : made.map.keyframes) {
    keyframe.accelerometer_bias.setZero();
    if (id > 0) keyframe.velocity_in_world += Eigen::Vector3d(0.02, -0.02, 0.01);
  }
  SyntheticMap visual = made;
  const RefineOptions options;
  RefineContext context{options};
  GlobalBundle().Process(made.map, context);
  EXPECT_EQ(context.report["inertial_links"], 24);
  RefineOptions without;
  without.global_bundle.use_imu = false;
  RefineContext context_without{without};
  GlobalBundle().Process(visual.map, context_without);
  EXPECT_EQ(context_without.report["inertial_links"], 0);
  EXPECT_LT((made.map.keyframes.at(12).accelerometer_bias - kAccelerometerBias).norm(), 0.03);
  EXPECT_LT(KeyframeError(made.map, made.true_world_from_cam),
            KeyframeError(visual.map, visual.true_world_from_cam));
}

}  // namespace
}  // namespace airslam
