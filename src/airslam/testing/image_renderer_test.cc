// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/testing/image_renderer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "airslam/testing/synthetic_motion.h"
#include "airslam/testing/synthetic_rig.h"

namespace airslam {
namespace {

Rigid3 BodyPose(const StereoRig& rig, double seconds) {
  SyntheticTrajectory trajectory = SyntheticTrajectory::Loop();
  trajectory.Mount(HeadingFromBody(rig), 0);
  return trajectory.At(std::llround(seconds * 1e9)).world_from_body;
}

// A view and the camera that took it.
struct View {
  RigCamera camera;
  Rigid3 world_from_cam;
  RenderedImage rendered;
};

View Take(const SyntheticWorld& world, const RigCamera& camera, const Rigid3& world_from_body) {
  const ImageRenderer renderer(world, camera.camera);
  View view{camera, world_from_body * camera.body_from_cam, {}};
  view.rendered = renderer.Render(view.world_from_cam);
  return view;
}

double Bilinear(const cv::Mat& image, const Eigen::Vector2d& pixel) {
  const int x = static_cast<int>(pixel.x()), y = static_cast<int>(pixel.y());
  const double fx = pixel.x() - x, fy = pixel.y() - y;
  return (1 - fy) *
             ((1 - fx) * image.at<std::uint8_t>(y, x) + fx * image.at<std::uint8_t>(y, x + 1)) +
         fy * ((1 - fx) * image.at<std::uint8_t>(y + 1, x) +
               fx * image.at<std::uint8_t>(y + 1, x + 1));
}

struct Agreement {
  std::vector<double> grey;  // absolute difference of grey values
  int hidden = 0;            // depth of the other view says: another surface
};

// Carries pixels of one view into another through the exact depth of the first.
Agreement Compare(const View& from, const View& to) {
  Agreement agreement;
  const Rigid3 to_from_from = to.world_from_cam.Inverse() * from.world_from_cam;
  for (int y = 4; y < from.rendered.image.rows - 4; y += 3) {
    for (int x = 4; x < from.rendered.image.cols - 4; x += 3) {
      const float depth = from.rendered.depth.at<float>(y, x);
      Eigen::Vector3d ray;
      if (depth <= 0 || !from.camera.camera.Unproject({x, y}, &ray)) continue;
      const Eigen::Vector3d point = to_from_from * Eigen::Vector3d(ray * depth);
      if (point.z() < 0.1 || std::abs(point.x()) > point.z() || std::abs(point.y()) > point.z()) {
        continue;
      }
      const Eigen::Vector2d pixel = to.camera.camera.Project(point);
      if (!to.camera.camera.pinhole.Contains(pixel, 2)) continue;
      const float seen = to.rendered.depth.at<float>(static_cast<int>(std::lround(pixel.y())),
                                                     static_cast<int>(std::lround(pixel.x())));
      if (std::abs(seen - point.z()) > 0.05 * point.z()) {
        ++agreement.hidden;
        continue;
      }
      agreement.grey.push_back(std::abs(Bilinear(to.rendered.image, pixel) -
                                        from.rendered.image.at<std::uint8_t>(y, x)));
    }
  }
  std::sort(agreement.grey.begin(), agreement.grey.end());
  return agreement;
}

void ExpectConsistent(const View& from, const View& to) {
  const Agreement agreement = Compare(from, to);
  ASSERT_GT(agreement.grey.size(), 3000u);
  EXPECT_LT(agreement.grey[agreement.grey.size() / 2], 2.0);
  EXPECT_LT(agreement.grey[agreement.grey.size() * 9 / 10], 12.0);
  EXPECT_LT(agreement.hidden, static_cast<int>(agreement.grey.size() / 5));
}

TEST(ImageRendererTest, StereoViewsAgreeThroughExactDepth) {
  const SyntheticWorld world;
  for (const StereoRig& rig : {IdealRig(376, 240), EurocLikeRig(376, 240)}) {
    const Rigid3 pose = BodyPose(rig, 3);
    ExpectConsistent(Take(world, rig.left, pose), Take(world, rig.right, pose));
  }
}

TEST(ImageRendererTest, ViewsAlongThePathAgreeThroughExactDepth) {
  const SyntheticWorld world;
  const StereoRig rig = EurocLikeRig(376, 240);
  const View first = Take(world, rig.left, BodyPose(rig, 3));
  ExpectConsistent(first, Take(world, rig.left, BodyPose(rig, 3.2)));
  // A wrong pose must not pass: the comparison can fail.
  View wrong = Take(world, rig.left, BodyPose(rig, 3.2));
  wrong.world_from_cam.translation += wrong.world_from_cam.rotation * Eigen::Vector3d(0.05, 0, 0);
  const Agreement agreement = Compare(first, wrong);
  EXPECT_GT(agreement.grey[agreement.grey.size() / 2], 4.0);
}

TEST(ImageRendererTest, DepthIsThatOfTheRayCast) {
  const SyntheticWorld world;
  const StereoRig rig = EurocLikeRig(160, 104);
  const View view = Take(world, rig.left, BodyPose(rig, 1));
  for (int y = 0; y < 104; y += 5) {
    for (int x = 0; x < 160; x += 5) {
      Eigen::Vector3d ray;
      ASSERT_TRUE(rig.left.camera.Unproject({x, y}, &ray));
      const auto hit =
          world.Cast(view.world_from_cam.translation, view.world_from_cam.rotation * ray);
      ASSERT_TRUE(hit);
      EXPECT_NEAR(view.rendered.depth.at<float>(y, x), hit->distance, 1e-4 * hit->distance);
    }
  }
}

TEST(ImageRendererTest, ImagesHaveContrastAndRepeatBitByBit) {
  const SyntheticWorld world;
  const StereoRig rig = IdealRig(320, 240);
  const ImageRenderer renderer(world, rig.left.camera);
  const Rigid3 pose = BodyPose(rig, 5) * rig.left.body_from_cam;
  const Illumination light = Illumination::HeadLamp(7);
  cv::Scalar mean, deviation;
  cv::meanStdDev(renderer.Render(pose).image, mean, deviation);
  EXPECT_GT(mean[0], 60);
  EXPECT_LT(mean[0], 180);
  EXPECT_GT(deviation[0], 25);
  EXPECT_EQ(cv::norm(renderer.Render(pose, light).image, renderer.Render(pose, light).image,
                     cv::NORM_INF),
            0);
  EXPECT_GT(cv::norm(renderer.Render(pose, light).image,
                     renderer.Render(pose, Illumination::HeadLamp(8)).image, cv::NORM_INF),
            0);
}

TEST(ImageRendererTest, LightChangesTheImageAsItSays) {
  const SyntheticWorld world;
  const StereoRig rig = IdealRig(320, 240);
  const ImageRenderer renderer(world, rig.left.camera);
  const Rigid3 pose = BodyPose(rig, 5) * rig.left.body_from_cam;
  const double day = cv::mean(renderer.Render(pose).image)[0];
  const double dark = cv::mean(renderer.Render(pose, Illumination::Dark(1)).image)[0];
  EXPECT_NEAR(dark, day * 0.12 / 0.9, 2);
  Illumination lamp = Illumination::HeadLamp(1);
  lamp.noise = 0;
  const cv::Mat night = renderer.Render(pose, lamp).image;
  const double middle = cv::mean(night(cv::Rect(120, 90, 80, 60)))[0];
  const double border = cv::mean(night(cv::Rect(0, 90, 40, 60)))[0];
  EXPECT_GT(middle, 2 * border);
}

TEST(ImageRendererTest, TextureFadesToItsMeanWhenItIsTooFine) {
  double fine = 0, coarse = 0, mean_fine = 0, mean_coarse = 0;
  const int steps = 4000;
  for (int i = 0; i < steps; ++i) {
    const double u = -7 + 14.0 * i / steps, v = 0.31 * u;
    const double a = SurfaceAlbedo(9, 2, u, v, 0.001), b = SurfaceAlbedo(9, 2, u + 0.01, v, 0.001);
    const double c = SurfaceAlbedo(9, 2, u, v, 0.2), d = SurfaceAlbedo(9, 2, u + 0.01, v, 0.2);
    fine += std::abs(a - b), coarse += std::abs(c - d);
    mean_fine += a / steps, mean_coarse += c / steps;
  }
  EXPECT_GT(fine, 5 * coarse);
  EXPECT_NEAR(mean_fine, mean_coarse, 0.05);
}

}  // namespace
}  // namespace airslam
