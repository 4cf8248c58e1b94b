// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/geometry/triangulation.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "airslam/geometry/so3.h"

namespace airslam {
namespace {

using Observations = std::vector<RayObservation>;

const Eigen::Vector3d kPoint(0.5, -0.3, 6.0);

// Cameras around the origin that look along +z, a little turned.
Observations Cameras(int count, double spread, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-1, 1);
  Observations observations;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d turn(uniform(random), uniform(random), uniform(random));
    const Eigen::Vector3d centre(uniform(random), uniform(random), uniform(random));
    const Rigid3 world_from_cam(ExpSO3(0.2 * turn), spread * centre);
    RayObservation seen;
    seen.cam_from_world = world_from_cam.Inverse();
    seen.ray = seen.cam_from_world * kPoint;
    observations.push_back(seen);
  }
  return observations;
}

double Cost(const Observations& observations, const Eigen::Vector3d& point) {
  double cost = 0;
  for (const RayObservation& seen : observations) {
    const Eigen::Vector3d p = seen.cam_from_world * point;
    cost += (p.hnormalized() - seen.ray.hnormalized()).squaredNorm();
  }
  return cost;
}

TEST(TriangulatePoint, IsExactWithoutNoise) {
  for (const int count : {2, 3, 8}) {
    const auto point = TriangulatePoint(Cameras(count, 1.0, 3));
    ASSERT_TRUE(point) << count;
    EXPECT_LT((*point - kPoint).norm(), 1e-9) << count;
  }
}

TEST(TriangulatePoint, DoesNotCareForTheLengthOfTheRays) {
  Observations observations = Cameras(3, 1.0, 4);
  for (RayObservation& seen : observations) seen.ray *= 0.01;
  const auto point = TriangulatePoint(observations);
  ASSERT_TRUE(point);
  EXPECT_LT((*point - kPoint).norm(), 1e-9);
}

TEST(TriangulatePoint, IsAMinimumOfTheReprojectionErrorUnderNoise) {
  Observations observations = Cameras(6, 1.0, 5);
  std::mt19937 random(6);
  std::normal_distribution<double> noise(0, 0.002);
  for (RayObservation& seen : observations) {
    seen.ray /= seen.ray.z();
    seen.ray += Eigen::Vector3d(noise(random), noise(random), 0);
  }
  const auto point = TriangulatePoint(observations);
  ASSERT_TRUE(point);
  EXPECT_LT((*point - kPoint).norm(), 0.1);
  // The numeric gradient of the cost vanishes at the answer, which fits better than the truth.
  const double h = 1e-5;
  for (int axis = 0; axis < 3; ++axis) {
    const Eigen::Vector3d delta = h * Eigen::Vector3d::Unit(axis);
    const auto slope = [&](const Eigen::Vector3d& x) {
      return (Cost(observations, x + delta) - Cost(observations, x - delta)) / (2 * h);
    };
    EXPECT_NEAR(slope(*point), 0, 1e-9) << axis;
  }
  EXPECT_LT(Cost(observations, *point), Cost(observations, kPoint));
}

TEST(TriangulatePoint, RefusesTooLittleParallax) {
  Observations observations = Cameras(2, 0.01, 7);
  EXPECT_LT(LargestParallax(observations), 0.01);
  EXPECT_FALSE(TriangulatePoint(observations));
  TriangulationOptions lenient;
  lenient.min_parallax = 1e-5;
  EXPECT_TRUE(TriangulatePoint(observations, lenient));
}

TEST(TriangulatePoint, RefusesAPointBehindTheCameras) {
  // Rays that diverge: their lines meet behind both cameras.
  Observations observations(2);
  observations[0].cam_from_world.translation = {0.5, 0, 0};   // centre at x = -0.5
  observations[1].cam_from_world.translation = {-0.5, 0, 0};  // centre at x = +0.5
  observations[0].ray = {-0.1, 0, 1};
  observations[1].ray = {0.1, 0, 1};
  EXPECT_FALSE(TriangulatePoint(observations));
  std::swap(observations[0].ray, observations[1].ray);  // now they meet in front
  EXPECT_TRUE(TriangulatePoint(observations));
}

TEST(TriangulatePoint, RefusesDepthOutsideTheRange) {
  const Observations observations = Cameras(4, 1.0, 8);
  TriangulationOptions options;
  options.max_depth = 3;
  EXPECT_FALSE(TriangulatePoint(observations, options));
  options = {};
  options.min_depth = 10;
  EXPECT_FALSE(TriangulatePoint(observations, options));
}

TEST(TriangulatePoint, RefusesRaysThatMissEachOther) {
  Observations observations = Cameras(4, 1.0, 9);
  observations[2].ray += 0.05 * observations[2].ray.z() * Eigen::Vector3d(0, 1, 0);
  EXPECT_FALSE(TriangulatePoint(observations));
  TriangulationOptions options;
  options.max_error = 0.1;
  EXPECT_TRUE(TriangulatePoint(observations, options));
}

TEST(TriangulatePoint, NeedsTwoRays) {
  EXPECT_FALSE(TriangulatePoint(Cameras(1, 1.0, 10)));
  EXPECT_FALSE(TriangulatePoint({}));
}

TEST(LargestParallax, IsTheAngleAtThePoint) {
  Observations observations(2);
  observations[1].cam_from_world.translation = {-1, 0, 0};  // centre at x = 1
  observations[0].ray = {0, 0, 1};
  observations[1].ray = {-1, 0, 1};
  EXPECT_NEAR(LargestParallax(observations), std::atan(1.0), 1e-12);
}

}  // namespace
}  // namespace airslam
