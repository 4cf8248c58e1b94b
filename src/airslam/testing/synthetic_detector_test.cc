// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/testing/synthetic_detector.h"

#include <gtest/gtest.h>

#include <cmath>

#include "airslam/testing/image_renderer.h"
#include "airslam/testing/synthetic_motion.h"
#include "airslam/testing/synthetic_rig.h"

namespace airslam {
namespace {

class SyntheticDetectorTest : public ::testing::Test {
 protected:
  SyntheticDetectorTest() : renderer_(world_, rig_.left.camera) {
    trajectory_.Mount(HeadingFromBody(rig_), 0);
  }

  Rigid3 Pose(double seconds) const {
    return trajectory_.At(std::llround(seconds * 1e9)).world_from_body * rig_.left.body_from_cam;
  }

  RenderedImage Render(double seconds, const Illumination& light = {}) const {
    return renderer_.Render(Pose(seconds), light);
  }

  // Share of the matches that land within `pixels` of where exact depth and pose carry them.
  double ShareRight(const RenderedImage& from, double from_time, double to_time,
                    const Detections& a, const Detections& b, const std::vector<Match>& matches,
                    double pixels) const {
    const Rigid3 to_from_from = Pose(to_time).Inverse() * Pose(from_time);
    const Pinhole& pinhole = rig_.left.camera.pinhole;
    int right = 0;
    for (const Match& match : matches) {
      const Keypoint &p = a.keypoints[match.index0], &q = b.keypoints[match.index1];
      const float depth = from.depth.at<float>(static_cast<int>(std::lround(p.y)),
                                               static_cast<int>(std::lround(p.x)));
      const Eigen::Vector3d point = depth * pinhole.Unproject({p.x, p.y});
      const Eigen::Vector2d expected = pinhole.Project(to_from_from * point);
      right += (expected - Eigen::Vector2d(q.x, q.y)).norm() < pixels ? 1 : 0;
    }
    return static_cast<double>(right) /
           static_cast<double>(std::max<std::size_t>(1, matches.size()));
  }

  std::vector<Match> MatchBetween(const Detections& a, const Detections& b) const {
    const cv::Size size(rig_.left.camera.pinhole.width, rig_.left.camera.pinhole.height);
    return SyntheticMatcher().Match({a.keypoints, a.descriptors, size},
                                    {b.keypoints, b.descriptors, size});
  }

  SyntheticWorld world_;
  StereoRig rig_ = IdealRig(376, 240);
  SyntheticTrajectory trajectory_ = SyntheticTrajectory::Loop();
  ImageRenderer renderer_;
};

TEST_F(SyntheticDetectorTest, FindsKeypointsOfTheInterfacesForm) {
  const cv::Mat image = Render(2).image;
  SyntheticDetector detector;
  const Detections found = detector.Detect(image, {}, 300);
  ASSERT_EQ(found.keypoints.size(), 300u);
  ASSERT_EQ(found.descriptors.rows(), 300);
  ASSERT_EQ(found.descriptors.cols(), detector.descriptor_size());
  for (int i = 0; i < 300; ++i) {
    EXPECT_NEAR(found.descriptors.row(i).norm(), 1, 1e-4);
    if (i > 0) {
      EXPECT_LE(found.keypoints[i].score, found.keypoints[i - 1].score);
    }
  }
  EXPECT_EQ(detector.Detect(image, {}, 50).keypoints.size(), 50u);
  EXPECT_TRUE(detector.Detect(cv::Mat::zeros(240, 376, CV_8UC1), {}, 50).keypoints.empty());
}

TEST_F(SyntheticDetectorTest, KeepsOutOfTheMask) {
  const cv::Mat image = Render(2).image;
  cv::Mat mask = cv::Mat::zeros(image.size(), CV_8UC1);
  mask(cv::Rect(100, 40, 120, 150)).setTo(255);
  const Detections found = SyntheticDetector().Detect(image, mask, 300);
  EXPECT_GT(found.keypoints.size(), 40u);
  for (const Keypoint& keypoint : found.keypoints) {
    EXPECT_TRUE(keypoint.x > 98 && keypoint.x < 222 && keypoint.y > 38 && keypoint.y < 192);
  }
}

TEST_F(SyntheticDetectorTest, RepeatsBitByBit) {
  const cv::Mat image = Render(2).image;
  const Detections a = SyntheticDetector().Detect(image, {}, 300);
  const Detections b = SyntheticDetector().Detect(image, {}, 300);
  EXPECT_EQ(a.descriptors, b.descriptors);
  for (std::size_t i = 0; i < a.keypoints.size(); ++i) {
    EXPECT_EQ(a.keypoints[i].x, b.keypoints[i].x);
    EXPECT_EQ(a.keypoints[i].y, b.keypoints[i].y);
  }
}

TEST_F(SyntheticDetectorTest, MatchesSuccessiveFramesByDayAndInTheDark) {
  for (const bool dark : {false, true}) {
    const RenderedImage first = Render(2, dark ? Illumination::Dark(1) : Illumination::Day());
    const RenderedImage second = Render(2.1, dark ? Illumination::Dark(2) : Illumination::Day());
    const Detections a = SyntheticDetector().Detect(first.image, {}, 400);
    const Detections b = SyntheticDetector().Detect(second.image, {}, 400);
    const auto matches = MatchBetween(a, b);
    EXPECT_GT(matches.size(), dark ? 50u : 150u);
    EXPECT_GT(ShareRight(first, 2, 2.1, a, b, matches, 2.0), dark ? 0.75 : 0.9);
    for (std::size_t i = 1; i < matches.size(); ++i) {
      EXPECT_GT(matches[i].index0, matches[i - 1].index0);
    }
  }
}

TEST_F(SyntheticDetectorTest, DoesNotMatchOppositeViews) {
  const Detections a = SyntheticDetector().Detect(Render(2).image, {}, 300);
  const Detections b = SyntheticDetector().Detect(Render(12).image, {}, 300);
  EXPECT_LT(MatchBetween(a, b).size(), 25u);
}

}  // namespace
}  // namespace airslam
