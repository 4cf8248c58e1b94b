// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/sensor/distorted_camera.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <random>
#include <vector>

#include "airslam/sensor/test_cameras.h"

namespace airslam {
namespace {

// Pixels over the whole image, borders included.
std::vector<Eigen::Vector2d> PixelGrid(const Pinhole& pinhole) {
  std::vector<Eigen::Vector2d> pixels;
  for (int y = 0; y < pinhole.height; y += 7) {
    for (int x = 0; x < pinhole.width; x += 7) pixels.emplace_back(x, y);
  }
  pixels.emplace_back(pinhole.width - 1, pinhole.height - 1);
  return pixels;
}

std::vector<cv::Point3d> RandomPoints(double spread) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-spread, spread);
  std::vector<cv::Point3d> points;
  for (int i = 0; i < 200; ++i) points.emplace_back(2 * uniform(random), 2 * uniform(random), 2.0);
  return points;
}

cv::Matx33d CameraMatrix(const Pinhole& p) { return {p.fx, 0, p.cx, 0, p.fy, p.cy, 0, 0, 1}; }

TEST(DistortedCamera, RadialTangentialRoundTripOverTheWholeImage) {
  const DistortedCamera camera = EurocCamera();
  for (const Eigen::Vector2d& pixel : PixelGrid(camera.pinhole)) {
    Eigen::Vector3d point;
    ASSERT_TRUE(camera.Unproject(pixel, &point)) << pixel.transpose();
    EXPECT_EQ(point.z(), 1.0);
    EXPECT_LT((camera.Project(3.0 * point) - pixel).norm(), 1e-7) << pixel.transpose();
  }
}

TEST(DistortedCamera, EquidistantRoundTripOverItsImageCircle) {
  const DistortedCamera camera = FisheyeCamera();
  const auto& k = camera.coefficients;
  const double end = 89 * 3.14159265358979323846 / 180, s = end * end;  // z = 1 ends near here
  const double distorted_end = end * (1 + s * (k[0] + s * (k[1] + s * (k[2] + s * k[3]))));
  int inside = 0, outside = 0;
  for (const Eigen::Vector2d& pixel : PixelGrid(camera.pinhole)) {
    const double angle = camera.pinhole.Unproject(pixel).head<2>().norm();
    Eigen::Vector3d point;
    const bool ok = camera.Unproject(pixel, &point);
    (ok ? inside : outside)++;
    EXPECT_EQ(ok, angle < distorted_end) << pixel.transpose() << " angle " << angle;
    if (ok) {
      EXPECT_LT((camera.Project(point) - pixel).norm(), 1e-6) << pixel.transpose();
    }
  }
  EXPECT_GT(inside, outside);
  EXPECT_GT(outside, 0);
}

TEST(DistortedCamera, WithoutDistortionIsThePinhole) {
  DistortedCamera camera = EurocCamera();
  camera.model = Distortion::kNone;
  const Eigen::Vector3d point(0.4, -0.3, 2);
  EXPECT_LT((camera.Project(point) - camera.pinhole.Project(point)).norm(), 1e-12);
  Eigen::Vector3d back;
  ASSERT_TRUE(camera.Unproject(camera.Project(point), &back));
  EXPECT_LT((2 * back - point).norm(), 1e-12);
}

TEST(DistortedCamera, RadialTangentialAgreesWithOpenCv) {
  DistortedCamera camera = EurocCamera();
  camera.coefficients = {-0.2834, 0.0739, 0.004, -0.003};  // tangential terms that matter
  const std::vector<cv::Point3d> points = RandomPoints(0.7);
  std::vector<cv::Point2d> pixels;
  cv::projectPoints(points, cv::Vec3d(0, 0, 0), cv::Vec3d(0, 0, 0), CameraMatrix(camera.pinhole),
                    cv::Mat(4, 1, CV_64F, camera.coefficients.data()), pixels);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector2d ours = camera.Project({points[i].x, points[i].y, points[i].z});
    EXPECT_LT((ours - Eigen::Vector2d(pixels[i].x, pixels[i].y)).norm(), 1e-9);
  }
}

TEST(DistortedCamera, EquidistantAgreesWithOpenCv) {
  DistortedCamera camera = FisheyeCamera();
  const std::vector<cv::Point3d> points = RandomPoints(3);
  std::vector<cv::Point2d> pixels;
  cv::fisheye::projectPoints(points, pixels, cv::Vec3d(0, 0, 0), cv::Vec3d(0, 0, 0),
                             CameraMatrix(camera.pinhole),
                             cv::Mat(4, 1, CV_64F, camera.coefficients.data()));
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector2d ours = camera.Project({points[i].x, points[i].y, points[i].z});
    EXPECT_LT((ours - Eigen::Vector2d(pixels[i].x, pixels[i].y)).norm(), 1e-9);
  }
}

TEST(DistortedCamera, KnowsWhereTheDistortionFoldsBack) {
  DistortedCamera camera = EurocCamera();
  camera.coefficients = {-0.3, 0, 0, 0};  // r (1 - 0.3 r^2) grows up to r = 1 / sqrt(0.9)
  EXPECT_NEAR(camera.MaxRadius(), 1 / std::sqrt(0.9), 1e-12);
  // The largest distorted radius is 0.7027: a pixel beyond has no source.
  Eigen::Vector3d point;
  const auto at_radius = [&](double r) {
    return Eigen::Vector2d(camera.pinhole.fx * r + camera.pinhole.cx, camera.pinhole.cy);
  };
  EXPECT_TRUE(camera.Unproject(at_radius(0.70), &point));
  EXPECT_LT(point.x(), camera.MaxRadius());
  EXPECT_FALSE(camera.Unproject(at_radius(0.71), &point));
  camera.coefficients = {0.1, 0.01, 0, 0};
  EXPECT_EQ(camera.MaxRadius(), std::numeric_limits<double>::infinity());
}

TEST(DistortedCamera, MaxRadiusIsTheFirstRootOfTheSlope) {
  DistortedCamera camera = EurocCamera();
  camera.coefficients = {-0.4, 0.05, 0, 0};  // 1 - 1.2 s + 0.25 s^2 = 0: s = 1.0733 or 3.7267
  EXPECT_NEAR(camera.MaxRadius(), std::sqrt(1.07335), 1e-4);
  camera.coefficients = {-0.28, 0.07, 0, 0};  // always grows
  EXPECT_EQ(camera.MaxRadius(), std::numeric_limits<double>::infinity());
}

}  // namespace
}  // namespace airslam
