// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/refine/loop_verification.h"

#include <gtest/gtest.h>

#include "airslam/refine/test_refine.h"

namespace airslam {
namespace {

class VerifyLoopTest : public ::testing::Test {
 protected:
  std::optional<Loop> Verify(KeyframeId earlier, KeyframeId later) {
    return VerifyLoop(made_.map, earlier, later, parts_.matcher, options_, &refusal_);
  }
  SyntheticMap made_ = DriftingMap();
  TestParts parts_{made_.map};
  LoopClosureOptions options_;
  std::string refusal_;
};

TEST_F(VerifyLoopTest, FindsTheRelativePoseWithItsCovariance) {
  for (const auto& [earlier, later] : {std::pair(0, 20), {1, 20}, {2, 22}}) {
    const std::optional<Loop> loop = Verify(earlier, later);
    ASSERT_TRUE(loop) << refusal_;
    const Rigid3 truth =
        made_.true_world_from_cam.at(earlier).Inverse() * made_.true_world_from_cam.at(later);
    const Rigid3 error = truth.Inverse() * loop->earlier_from_later;
    EXPECT_LT(error.translation.norm(), 0.05);
    EXPECT_LT(error.Angle(), 0.01);
    // Within four standard deviations.
    Eigen::Matrix<double, 6, 1> e;
    e << 2 * error.rotation.vec(), error.translation;
    EXPECT_LT(std::sqrt(e.dot(loop->covariance.ldlt().solve(e))), 4 * std::sqrt(6.0));
  }
}

TEST_F(VerifyLoopTest, RefusesAnotherPlace) {
  EXPECT_FALSE(Verify(10, 20));
  EXPECT_EQ(refusal_, "too few inliers");
}

// Half of the landmarks of `later` are wrong in a consistent way: seen from there the place lies
// elsewhere.
TEST_F(VerifyLoopTest, RefusesWhenTheOtherWayRoundDisagrees) {
  for (auto& [id, landmark] : made_.map.landmarks) {
    if (landmark.first_seen_by >= 20) landmark.point_in_world *= 1.2;
  }
  const Rigid3 pose = made_.map.keyframes.at(20).world_from_cam;
  for (LandmarkId& id : made_.map.keyframes.at(20).landmarks) {
    Landmark& landmark = made_.map.landmarks.at(id);
    const Eigen::Vector3d p = pose.Inverse() * landmark.point_in_world;
    landmark.point_in_world = pose * (p + Eigen::Vector3d(0.5, 0, 0));
  }
  EXPECT_FALSE(Verify(0, 20));
  EXPECT_NE(refusal_, "too few inliers");
}

TEST_F(VerifyLoopTest, CountsInliers) {
  const std::optional<Loop> loop = Verify(0, 20);
  ASSERT_TRUE(loop);
  options_.min_inliers = loop->inliers;
  EXPECT_FALSE(Verify(0, 20));
  options_.min_inliers = loop->inliers - 1;
  EXPECT_TRUE(Verify(0, 20));
}

}  // namespace
}  // namespace airslam
