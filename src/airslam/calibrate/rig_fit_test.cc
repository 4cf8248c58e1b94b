// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/calibrate/rig_fit.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "airslam/geometry/so3.h"
#include "airslam/testing/synthetic_rig.h"

namespace airslam {
namespace {

// Points before the rig as its cameras see them, with noise; a share of them matched wrongly. The
// right camera is `late` seconds behind points that move to the lower right.
std::vector<RawMatch> MakeMatches(const StereoRig& rig, int count, double noise, double wrong,
                                  double late = 0) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal(0, noise);
  std::uniform_real_distribution<double> unit(0, 1);
  const Rigid3 right_from_left = rig.right.body_from_cam.Inverse() * rig.left.body_from_cam;
  const Eigen::Vector2d velocity(90, 60);
  std::vector<RawMatch> matches;
  while (static_cast<int>(matches.size()) < count) {
    const Pinhole& camera = rig.left.camera.pinhole;
    const Eigen::Vector2d pixel(unit(random) * camera.width, unit(random) * camera.height);
    Eigen::Vector3d ray;
    if (!rig.left.camera.Unproject(pixel, &ray)) continue;
    const Eigen::Vector3d point = right_from_left * Eigen::Vector3d(ray * (1 + 6 * unit(random)));
    RawMatch match;
    match.left = pixel + Eigen::Vector2d(normal(random), normal(random));
    match.right = rig.right.camera.Project(point) + Eigen::Vector2d(normal(random), normal(random));
    match.right += late * velocity * (1 + pixel.x() / camera.width);
    match.has_velocity = true;
    match.velocity = velocity * (1 + pixel.x() / camera.width);
    if (unit(random) < wrong) match.right.y() += 40 * (unit(random) - 0.5);
    if (rig.right.camera.pinhole.Contains(match.right)) matches.push_back(match);
  }
  return matches;
}

TEST(EpipolarGeometry, IsTheVerticalDisparityOfRectifiedImages) {
  const StereoRig rig = KittiLikeRig();
  const double focal = rig.left.camera.pinhole.fx;
  std::vector<RawMatch> matches = {{.left = {300, 200}, .right = {280, 203}},
                                   {.left = {300, 200}, .right = {310, 200}}};
  const std::vector<RayMatch> rays = ToRays(rig, matches);
  const EpipolarGeometry geometry(rig, {});
  EXPECT_NEAR(geometry.focal(), focal, 1e-9);
  EXPECT_NEAR(std::abs(geometry.Error(rays[0]).pixels), 3, 1e-6);
  EXPECT_NEAR(geometry.Error(rays[0]).parallax, 20, 2);  // an angle: a little less aside
  EXPECT_NEAR(geometry.Error(rays[1]).pixels, 0, 1e-6);
  EXPECT_LT(geometry.Error(rays[1]).parallax, -8);  // they meet behind
}

TEST(FitRig, OnlyEvaluatesWithNothingFree) {
  const StereoRig rig = EurocLikeRig();
  const RigFit fit = FitRig(rig, ToRays(rig, MakeMatches(rig, 500, 0.2, 0.05)), {});
  EXPECT_EQ(fit.size(), 500);
  // Of two images; undistorting stretches the border.
  EXPECT_GT(fit.noise, 0.2 * std::sqrt(2.0));
  EXPECT_LT(fit.noise, 0.4);
  EXPECT_NEAR(fit.Cost(fit.noise), 1.3, 0.3);
  EXPECT_LT(fit.BehindShare(fit.noise), 0.02);
}

TEST(FitRig, FindsATurnedCamera) {
  const StereoRig truth = EurocLikeRig();
  const Eigen::Vector3d turn(0.010, -0.015, 0.008);
  StereoRig rig = truth;
  rig.right.body_from_cam.rotation = truth.right.body_from_cam.rotation * ExpSO3(-turn);
  const std::vector<RayMatch> rays = ToRays(rig, MakeMatches(truth, 1000, 0.2, 0.1));
  const RigFit fit = FitRig(rig, rays, {.turn = true});
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(fit.correction.turn[i], turn[i], 5 * fit.sigma.turn[i] + 1e-5) << i;
    EXPECT_GT(fit.sigma.turn[i], 0);
    EXPECT_LT(fit.sigma.turn[i], 1e-3);
  }
  const RigFit before = FitRig(rig, rays, {});
  EXPECT_GT(SystematicError(before, fit), 4);
  EXPECT_LT(SystematicError(fit, fit), 1e-9);
}

TEST(FitRig, FindsBentRays) {
  const StereoRig truth = EurocLikeRig();
  StereoRig rig = truth;
  rig.left.camera.coefficients = rig.right.camera.coefficients = {0, 0, 0, 0};
  const std::vector<RayMatch> rays = ToRays(rig, MakeMatches(truth, 1000, 0.2, 0.1));
  const RigFit before = FitRig(rig, rays, {}), after = FitRig(rig, rays, {.radial = true});
  EXPECT_GT(before.noise, 1.5 * after.noise);
  EXPECT_NEAR(after.correction.left_radial[0], 0.28, 0.1);  // undistorting is the inverse
}

TEST(FitRig, FindsALateCamera) {
  const StereoRig rig = EurocLikeRig();
  const std::vector<RayMatch> rays = ToRays(rig, MakeMatches(rig, 1000, 0.2, 0.1, 0.03));
  const RigFit fit = FitRig(rig, rays, {.delay = true});
  EXPECT_NEAR(fit.correction.delay, 0.03, 5 * fit.sigma.delay + 2e-4);
  EXPECT_GT(FitRig(rig, rays, {}).noise, 3 * fit.noise);
}

TEST(AbsoluteQuantile, OfMagnitudes) {
  EXPECT_EQ(AbsoluteQuantile({}, 0.5), 0);
  EXPECT_EQ(AbsoluteQuantile(std::vector<double>{-3, 1, 2}, 0.5), 2);
  EXPECT_EQ(AbsoluteQuantile(std::vector<double>{-3, 1, 2}, 1), 3);
}

}  // namespace
}  // namespace airslam
