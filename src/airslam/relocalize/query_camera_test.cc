// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/relocalize/query_camera.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

#include "airslam/sensor/temporary_folder.h"
#include "airslam/testing/synthetic_rig.h"

namespace airslam {
namespace {

// Where the brightest spot of an image lies.
Eigen::Vector2d Spot(const cv::Mat& image) {
  const cv::Moments m = cv::moments(image);
  return {m.m10 / m.m00, m.m01 / m.m00};
}

TEST(QueryCameraTest, TakesOutTheDistortionAndDoesNotTurn) {
  const RigCamera raw = EurocLikeRig().left;
  const QueryCamera camera(raw);
  EXPECT_TRUE(camera.body_from_cam().ToMatrix().isApprox(raw.body_from_cam.ToMatrix(), 1e-9));
  EXPECT_EQ(camera.pinhole().width, 752);
  for (const Eigen::Vector3d& point :
       {Eigen::Vector3d(0, 0, 2), Eigen::Vector3d(-1.1, 0.6, 2), Eigen::Vector3d(1, 0.5, 2)}) {
    const Eigen::Vector2d pixel = raw.camera.Project(point);
    cv::Mat image(480, 752, CV_8UC1, cv::Scalar(0));
    cv::circle(image, cv::Point(cvRound(pixel.x() * 16), cvRound(pixel.y() * 16)), 3 * 16,
               cv::Scalar(255), cv::FILLED, cv::LINE_AA, 4);
    EXPECT_LT((Spot(camera.Undistort(image)) - camera.pinhole().Project(point)).norm(), 0.3);
  }
}

TEST(QueryCameraTest, MasksWhatHasNoSource) {
  RigCamera raw = EurocLikeRig().left;
  raw.camera.coefficients = {0.2, 0.05, 0, 0};  // a pincushion lens: the corners lack a source
  const QueryCamera camera(raw);
  ASSERT_FALSE(camera.mask().empty());
  EXPECT_EQ(camera.mask().at<uchar>(240, 376), 255);
  EXPECT_EQ(camera.mask().at<uchar>(0, 0), 0);
}

TEST(QueryCameraTest, PassesImagesWithoutDistortionThrough) {
  RigCamera raw = EurocLikeRig().left;
  raw.camera.model = Distortion::kNone;
  const QueryCamera camera(raw);
  const cv::Mat image(480, 752, CV_8UC1, cv::Scalar(7));
  EXPECT_EQ(camera.Undistort(image).data, image.data);
  EXPECT_EQ(camera.pinhole().fx, raw.camera.pinhole.fx);
  EXPECT_TRUE(camera.mask().empty());
  EXPECT_THAT(ErrorOf([&] { camera.Undistort(cv::Mat(4, 4, CV_8UC1)); }),
              testing::HasSubstr("4x4 pixels, but the calibration says 752x480"));
}

}  // namespace
}  // namespace airslam
