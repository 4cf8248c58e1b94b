// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/feature/patch_alignment.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>

namespace airslam {
namespace {

// A smooth texture that can be sampled anywhere, so that sub-pixel truth is exact.
double Texture(double x, double y) {
  return 120 + 35 * std::sin(0.45 * x + 0.2 * y) + 30 * std::cos(0.31 * y - 0.17 * x) +
         20 * std::sin(0.8 * x) * std::cos(0.7 * y);
}

// image(p) = gain * texture(texture_from_image * p) + offset.
cv::Mat Render(const Eigen::Matrix2d& linear, const Eigen::Vector2d& shift, double gain,
               double offset) {
  cv::Mat image(80, 100, CV_8UC1);
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const Eigen::Vector2d p = linear * Eigen::Vector2d(x, y) + shift;
      image.at<std::uint8_t>(y, x) =
          cv::saturate_cast<std::uint8_t>(gain * Texture(p.x(), p.y()) + offset);
    }
  }
  return image;
}

const Eigen::Matrix2d kIdentity = Eigen::Matrix2d::Identity();

TEST(PatchAlignment, FindsSubPixelShift) {
  const Eigen::Vector2d shift(0.37, -0.61);
  const cv::Mat reference = Render(kIdentity, {0, 0}, 1, 0);
  const cv::Mat current = Render(kIdentity, shift, 1, 0);
  const Eigen::Vector2d pixel(50.25, 40.5);
  const PatchAlignment found =
      AlignPatch(reference, pixel, kIdentity, current, pixel + Eigen::Vector2d(1.2, 1.0), {});
  ASSERT_TRUE(found.converged);
  EXPECT_LT((found.pixel - (pixel - shift)).norm(), 0.03);
  EXPECT_GT(found.correlation, 0.99);
}

TEST(PatchAlignment, IgnoresGainAndOffset) {
  const Eigen::Vector2d shift(-0.3, 0.45);
  const cv::Mat reference = Render(kIdentity, {0, 0}, 1, 0);
  const cv::Mat dark = Render(kIdentity, shift, 0.15, 5);
  const Eigen::Vector2d pixel(45, 38);
  const PatchAlignment found = AlignPatch(reference, pixel, kIdentity, dark, pixel, {});
  ASSERT_TRUE(found.converged);
  EXPECT_LT((found.pixel - (pixel - shift)).norm(), 0.06);
}

TEST(PatchAlignment, FollowsTheChangeOfShape) {
  Eigen::Matrix2d reference_from_current;
  reference_from_current << 0.75, 0.15, -0.1, 0.8;
  const cv::Mat reference = Render(kIdentity, {0, 0}, 1, 0);
  const cv::Mat current = Render(reference_from_current, {6.3, 11.2}, 1, 0);
  const Eigen::Vector2d truth(52.4, 41.7);
  const Eigen::Vector2d pixel = reference_from_current * truth + Eigen::Vector2d(6.3, 11.2);
  const PatchAlignment found = AlignPatch(reference, pixel, reference_from_current.inverse(),
                                          current, truth + Eigen::Vector2d(0.8, -0.7), {});
  ASSERT_TRUE(found.converged);
  EXPECT_LT((found.pixel - truth).norm(), 0.04);
}

TEST(PatchAlignment, RefusesFlatEdgesAndOtherTextures) {
  const Eigen::Vector2d pixel(50, 40);
  const cv::Mat textured = Render(kIdentity, {0, 0}, 1, 0);
  const cv::Mat flat(80, 100, CV_8UC1, cv::Scalar(90));
  EXPECT_FALSE(AlignPatch(flat, pixel, kIdentity, flat, pixel, {}).converged);
  cv::Mat edge = flat.clone();
  edge.colRange(50, 100).setTo(160);
  EXPECT_FALSE(AlignPatch(edge, pixel, kIdentity, edge, pixel, {}).converged);
  const cv::Mat other = Render(kIdentity, {777.7, 431.1}, 1, 0);
  EXPECT_FALSE(AlignPatch(textured, pixel, kIdentity, other, pixel, {}).converged);
}

TEST(PatchAlignment, RefusesPlacesOutsideTheImages) {
  const cv::Mat image = Render(kIdentity, {0, 0}, 1, 0);
  EXPECT_FALSE(AlignPatch(image, {2, 40}, kIdentity, image, {2, 40}, {}).converged);
  EXPECT_FALSE(AlignPatch(image, {50, 40}, kIdentity, image, {98, 40}, {}).converged);
  EXPECT_FALSE(AlignPatch(image, {50, 40}, kIdentity, image, {-500, 1e9}, {}).converged);
}

TEST(PatchAlignment, ReachesTheBorder) {
  // Images of their own memory, of which a patch uses the last pixel and nothing beyond.
  const cv::Mat reference = Render(kIdentity, {0, 0}, 1, 0);
  const Eigen::Vector2d first(6.1, 6.2), last(reference.cols - 7.1, reference.rows - 7.2);
  const Eigen::Vector2d outward(0.7, 0.6);
  const auto expect_found = [&](const Eigen::Vector2d& pixel, const Eigen::Vector2d& shift) {
    const cv::Mat current = Render(kIdentity, shift, 1, 0);
    const PatchAlignment found = AlignPatch(reference, pixel, kIdentity, current, pixel, {});
    ASSERT_TRUE(found.converged);
    EXPECT_LT((found.pixel - (pixel - shift)).norm(), 0.03);
  };
  expect_found(first, outward);
  expect_found(last, -outward);
}

}  // namespace
}  // namespace airslam
