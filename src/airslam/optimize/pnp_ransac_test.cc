// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/pnp_ransac.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "airslam/sensor/temporary_folder.h"

namespace airslam {
namespace {

const Pinhole kCamera{450, 460, 370, 245, 752, 480};

Rigid3 TruePose() {
  return {Eigen::Quaterniond(0.9, 0.1, -0.3, 0.05), Eigen::Vector3d(0.3, -1.2, 2)};
}

// `good` sightings with a noise of half a pixel, then `bad` ones at random pixels.
std::vector<PointSighting> Sightings(int good, int bad) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::normal_distribution<double> noise(0, 0.5);
  std::vector<PointSighting> sightings;
  const Rigid3 world_from_cam = TruePose().Inverse();
  for (int i = 0; i < good + bad; ++i) {
    Eigen::Vector2d pixel(752 * uniform(random), 480 * uniform(random));
    const Eigen::Vector3d point =
        world_from_cam * Eigen::Vector3d(kCamera.Unproject(pixel) * (2 + 6 * uniform(random)));
    pixel += Eigen::Vector2d(noise(random), noise(random));
    if (i >= good) pixel = {752 * uniform(random), 480 * uniform(random)};
    sightings.push_back({point, pixel});
  }
  return sightings;
}

TEST(PnpRansacTest, FindsThePoseAmongManyOutliers) {
  for (const bool minimal : {true, false}) {
    PnpRansacOptions options;
    options.minimal = minimal;
    const int bad = minimal ? 90 : 40;
    const PnpRansacResult result = EstimatePnpRansac(kCamera, Sightings(40, bad), options);
    ASSERT_GE(result.inliers.size(), 35U);
    EXPECT_LE(result.inliers.size(), 44U);
    const Rigid3 error = result.cam_from_world * TruePose().Inverse();
    EXPECT_LT(error.Angle(), 0.01);
    EXPECT_LT(error.translation.norm(), 0.05);
  }
}

TEST(PnpRansacTest, RepeatsToTheBit) {
  const auto sightings = Sightings(30, 60);
  const PnpRansacResult first = EstimatePnpRansac(kCamera, sightings, {});
  const PnpRansacResult second = EstimatePnpRansac(kCamera, sightings, {});
  EXPECT_EQ(first.inliers, second.inliers);
  EXPECT_EQ(first.cam_from_world.translation, second.cam_from_world.translation);
}

TEST(PnpRansacTest, FewOrWrongSightingsHaveFewInliers) {
  EXPECT_TRUE(EstimatePnpRansac(kCamera, Sightings(5, 0), {}).inliers.empty());
  EXPECT_LT(EstimatePnpRansac(kCamera, Sightings(0, 80), {}).inliers.size(), 15U);
}

TEST(PnpRansacTest, OptionsAreChecked) {
  const auto error = [](const PnpRansacOptions& options) {
    return ErrorOf([&] { options.Validate(); });
  };
  EXPECT_THAT(error({.max_error = 0}), testing::HasSubstr("max_error"));
  EXPECT_THAT(error({.iterations = 0}), testing::HasSubstr("iterations"));
  EXPECT_THAT(error({.confidence = 1}), testing::HasSubstr("confidence"));
  EXPECT_EQ(error({}), "");
}

}  // namespace
}  // namespace airslam
