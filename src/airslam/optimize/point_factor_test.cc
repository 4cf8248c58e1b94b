// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/point_factor.h"

#include <ceres/gradient_checker.h>
#include <gtest/gtest.h>

#include "airslam/optimize/pose_parameter.h"

namespace airslam {
namespace {

const StereoCamera kStereo{{450, 470, 320, 240, 640, 480}, 0.12};  // fx differs from fy
const Rigid3 kWorldFromCam{Eigen::Quaterniond(0.8, 0.3, -0.4, 0.33), {1.0, -2.0, 0.5}};
const Eigen::Vector3d kPointInCam(0.7, -0.4, 3.2);

void CheckGradient(const ceres::CostFunction& factor, std::vector<const double*> blocks,
                   const PoseManifold& pose_manifold) {
  std::vector<const ceres::Manifold*> manifolds = {&pose_manifold};
  if (blocks.size() == 2) manifolds.push_back(nullptr);
  const ceres::GradientChecker checker(&factor, &manifolds, ceres::NumericDiffOptions());
  ceres::GradientChecker::ProbeResults results;
  EXPECT_TRUE(checker.Probe(blocks.data(), 1e-6, &results)) << results.error_log;
}

TEST(PointFactor, ProjectsIntoBothImages) {
  const PoseParameter pose = ToParameter(kWorldFromCam);
  const Eigen::Vector3d point = kWorldFromCam * kPointInCam;
  const PointObservation seen{{100, 200}, 80, 0.5};
  const PointFactor factor(kStereo, seen);
  const double* blocks[] = {pose.data(), point.data()};
  double residuals[3];
  ASSERT_TRUE(factor.Evaluate(blocks, residuals, nullptr));
  const double u = 450 * 0.7 / 3.2 + 320, v = 470 * -0.4 / 3.2 + 240;
  EXPECT_NEAR(residuals[0], (u - 100) / 0.5, 1e-9);
  EXPECT_NEAR(residuals[1], (v - 200) / 0.5, 1e-9);
  EXPECT_NEAR(residuals[2], (u - 450 * 0.12 / 3.2 - 80) / 0.5, 1e-9);
}

TEST(PointFactor, JacobianOfStereoAndMonocularObservations) {
  const PoseParameter pose = ToParameter(kWorldFromCam);
  const Eigen::Vector3d point = kWorldFromCam * kPointInCam;
  const PoseManifold manifold;
  CheckGradient(PointFactor(kStereo, {{100, 200}, 80, 0.5}), {pose.data(), point.data()}, manifold);
  CheckGradient(PointFactor(kStereo, {{100, 200}, -1, 2.0}), {pose.data(), point.data()}, manifold);
}

TEST(PointFactor, PointBehindTheCameraIsAnOutlierWithoutDerivative) {
  const PoseParameter pose = ToParameter(kWorldFromCam);
  const Eigen::Vector3d point = kWorldFromCam * Eigen::Vector3d(0, 0, -1);
  const PointFactor factor(kStereo, {{100, 200}, 80, 1});
  const double* blocks[] = {pose.data(), point.data()};
  double residuals[3];
  double by_pose[21], by_point[9];
  double* jacobians[] = {by_pose, by_point};
  ASSERT_TRUE(factor.Evaluate(blocks, residuals, jacobians));
  for (double r : residuals) EXPECT_EQ(r, PointFactor::kBehindResidual);
  for (double j : by_pose) EXPECT_EQ(j, 0);
  for (double j : by_point) EXPECT_EQ(j, 0);
}

}  // namespace
}  // namespace airslam
