// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/sensor/rectification.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <ostream>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "airslam/sensor/temporary_folder.h"
#include "airslam/sensor/test_cameras.h"

namespace airslam {
namespace {

using testing::HasSubstr;

struct NamedRig {
  std::string name;
  StereoRig rig;

  friend std::ostream& operator<<(std::ostream& stream, const NamedRig& named) {
    return stream << named.name;
  }
};

class RectifiedRig : public testing::TestWithParam<NamedRig> {
 protected:
  const StereoRig& rig() const { return GetParam().rig; }

  // Points in the body frame that both raw cameras see.
  std::vector<Eigen::Vector3d> Points() const {
    std::mt19937 random(1);
    std::uniform_real_distribution<double> uniform(-1, 1);
    std::vector<Eigen::Vector3d> points;
    while (points.size() < 300) {
      const double depth = 3 + 2.5 * uniform(random);
      const Eigen::Vector3d in_left(0.8 * depth * uniform(random), 0.6 * depth * uniform(random),
                                    depth);
      const Eigen::Vector3d in_body = rig().left.body_from_cam * in_left;
      if (Sees(rig().left, in_body) && Sees(rig().right, in_body)) points.push_back(in_body);
    }
    return points;
  }

  static Eigen::Vector2d RawPixel(const RigCamera& camera, const Eigen::Vector3d& point_in_body) {
    return camera.camera.Project(camera.body_from_cam.Inverse() * point_in_body);
  }

  static bool Sees(const RigCamera& camera, const Eigen::Vector3d& point_in_body) {
    const Eigen::Vector3d p = camera.body_from_cam.Inverse() * point_in_body;
    return p.z() > 0.1 && p.head<2>().norm() / p.z() < camera.camera.MaxRadius() &&
           camera.camera.pinhole.Contains(camera.camera.Project(p));
  }

  // Where a raw pixel comes to lie: the raw model undone, then R_rect, then the rectified pinhole.
  static Eigen::Vector2d RectifiedPixel(const RigCamera& camera, const Eigen::Matrix3d& rotation,
                                        const Pinhole& pinhole, const Eigen::Vector2d& raw) {
    Eigen::Vector3d ray;
    EXPECT_TRUE(camera.camera.Unproject(raw, &ray));
    return pinhole.Project(rotation * ray);
  }
};

TEST_P(RectifiedRig, ExtrinsicRotatesWithTheCamera) {
  const StereoRectifier rectifier(rig());
  const Pinhole& pinhole = rectifier.stereo().camera;
  for (const Eigen::Vector3d& point : Points()) {
    const Eigen::Vector2d through_raw =
        RectifiedPixel(rig().left, rectifier.left_rotation(), pinhole, RawPixel(rig().left, point));
    const Eigen::Vector2d through_extrinsic =
        pinhole.Project(rectifier.body_from_left().Inverse() * point);
    EXPECT_LT((through_raw - through_extrinsic).norm(), 1e-6);
  }
  // body_from_rectified = body_from_raw * R_rect^T, and the optical centre stays.
  const Eigen::Matrix3d expected =
      rig().left.body_from_cam.rotation * rectifier.left_rotation().transpose();
  EXPECT_LT((rectifier.body_from_left().rotation.toRotationMatrix() - expected).norm(), 1e-12);
  EXPECT_EQ(rectifier.body_from_left().translation, rig().left.body_from_cam.translation);
}

TEST_P(RectifiedRig, UnrotatedExtrinsicWouldBeWrong) {
  const StereoRectifier rectifier(rig());
  const Pinhole& pinhole = rectifier.stereo().camera;
  double sum = 0;
  for (const Eigen::Vector3d& point : Points()) {
    const Eigen::Vector2d true_pixel =
        pinhole.Project(rectifier.body_from_left().Inverse() * point);
    const Eigen::Vector2d wrong_pixel = pinhole.Project(rig().left.body_from_cam.Inverse() * point);
    sum += (true_pixel - wrong_pixel).norm();
  }
  EXPECT_GT(sum / Points().size(), 2.0);  // pixels
}

TEST_P(RectifiedRig, RowsAgreeAndDisparityGivesDepth) {
  const StereoRectifier rectifier(rig());
  const StereoCamera& stereo = rectifier.stereo();
  EXPECT_NEAR(stereo.baseline, rig().Baseline(), 1e-12);
  for (const Eigen::Vector3d& point : Points()) {
    const Eigen::Vector2d left = RectifiedPixel(rig().left, rectifier.left_rotation(),
                                                stereo.camera, RawPixel(rig().left, point));
    const Eigen::Vector2d right = RectifiedPixel(rig().right, rectifier.right_rotation(),
                                                 stereo.camera, RawPixel(rig().right, point));
    EXPECT_NEAR(left.y(), right.y(), 1e-3);
    const double depth = (rectifier.body_from_left().Inverse() * point).z();
    EXPECT_NEAR(stereo.Depth(left.x() - right.x()), depth, 1e-5 * depth);
  }
}

// The centre of mass of a blob that is drawn at a raw pixel and then rectified.
Eigen::Vector2d BlobCentre(const cv::Mat& image) {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  double mass = 0;
  for (int v = 0; v < image.rows; ++v) {
    for (int u = 0; u < image.cols; ++u) {
      const double value = image.at<uchar>(v, u);
      sum += value * Eigen::Vector2d(u, v);
      mass += value;
    }
  }
  return sum / mass;
}

cv::Mat BlobImage(const Pinhole& camera, const Eigen::Vector2d& centre) {
  cv::Mat image(camera.height, camera.width, CV_8UC1);
  for (int v = 0; v < image.rows; ++v) {
    for (int u = 0; u < image.cols; ++u) {
      const double square = (Eigen::Vector2d(u, v) - centre).squaredNorm();
      image.at<uchar>(v, u) = cv::saturate_cast<uchar>(250 * std::exp(-square / (2 * 2.0 * 2.0)));
    }
  }
  return image;
}

TEST_P(RectifiedRig, ImagesMoveAsTheGeometrySays) {
  const StereoRectifier rectifier(rig());
  const Pinhole& pinhole = rectifier.stereo().camera;
  const Rigid3 left_from_body = rectifier.body_from_left().Inverse();
  int seen = 0;
  for (const Eigen::Vector3d& point : Points()) {
    const Eigen::Vector3d in_left = left_from_body * point;
    const Eigen::Vector3d in_right = in_left - Eigen::Vector3d(rectifier.stereo().baseline, 0, 0);
    const Eigen::Vector2d left = pinhole.Project(in_left), right = pinhole.Project(in_right);
    if (!pinhole.Contains(left, 25) || !pinhole.Contains(right, 25)) continue;
    const Eigen::Vector2d raw_left = RawPixel(rig().left, point);
    const Eigen::Vector2d raw_right = RawPixel(rig().right, point);
    const Eigen::Vector2d left_blob =
        BlobCentre(rectifier.RectifyLeft(BlobImage(rig().left.camera.pinhole, raw_left)));
    const Eigen::Vector2d right_blob =
        BlobCentre(rectifier.RectifyRight(BlobImage(rig().right.camera.pinhole, raw_right)));
    EXPECT_LT((left_blob - left).norm(), 0.25);  // a blob is no point: distortion shifts its centre
    EXPECT_LT((right_blob - right).norm(), 0.25);
    EXPECT_NEAR(left_blob.y(), right_blob.y(), 0.1);
    if (++seen == 20) break;
  }
  EXPECT_EQ(seen, 20);
}

TEST_P(RectifiedRig, MaskSaysWhatHasASource) {
  const StereoRectifier rectifier(rig());
  const Pinhole& pinhole = rectifier.stereo().camera;
  const auto check = [&](const RigCamera& camera, const Eigen::Matrix3d& rotation,
                         const cv::Mat& mask) {
    int valid = 0, all = 0;
    for (int v = 0; v < pinhole.height; v += 3) {
      for (int u = 0; u < pinhole.width; u += 3) {
        const Eigen::Vector3d ray = rotation.transpose() * pinhole.Unproject(Eigen::Vector2d(u, v));
        const bool has_source = ray.z() > 0 &&
                                ray.head<2>().norm() / ray.z() < camera.camera.MaxRadius() &&
                                camera.camera.pinhole.Contains(camera.camera.Project(ray));
        const bool in_mask = mask.empty() || mask.at<uchar>(v, u) == 255;
        EXPECT_EQ(in_mask, has_source) << u << " " << v;
        valid += in_mask;
        ++all;
      }
    }
    EXPECT_GT(valid, 0.9 * all);  // the invalid part must not dominate
  };
  check(rig().left, rectifier.left_rotation(), rectifier.left_mask());
  check(rig().right, rectifier.right_rotation(), rectifier.right_mask());
}

TEST_P(RectifiedRig, FocalLengthIsTheMeanOrLittleLess) {
  const StereoRectifier rectifier(rig());
  const Pinhole& pinhole = rectifier.stereo().camera;
  const Pinhole &left = rig().left.camera.pinhole, &right = rig().right.camera.pinhole;
  const double mean = (left.fx + left.fy + right.fx + right.fy) / 4;
  EXPECT_EQ(pinhole.fx, pinhole.fy);
  EXPECT_LE(pinhole.fx, mean + 1e-9);
  EXPECT_GE(pinhole.fx, 0.9 * mean - 1e-9);
  EXPECT_EQ(pinhole.width, left.width);
  EXPECT_EQ(pinhole.height, left.height);
  if (pinhole.fx < mean - 1e-9) {  // widened, so every pixel has a source
    EXPECT_TRUE(rectifier.left_mask().empty());
    EXPECT_TRUE(rectifier.right_mask().empty());
  }
}

StereoRig TurnedPinholeRig() {
  StereoRig rig = WarehouseRig();
  for (RigCamera* camera : {&rig.left, &rig.right}) {
    camera->camera.model = Distortion::kNone;
    camera->body_from_cam = Rigid3();
  }
  rig.right.body_from_cam = Rigid3(ExpSO3({0.02, 0.03, -0.01}), {0.12, 0.004, -0.003});
  return rig;
}

INSTANTIATE_TEST_SUITE_P(Rigs, RectifiedRig,
                         testing::Values(NamedRig{"Warehouse", WarehouseRig()},
                                         NamedRig{"Fisheye", FisheyeRig()},
                                         NamedRig{"TurnedPinhole", TurnedPinholeRig()}),
                         [](const testing::TestParamInfo<NamedRig>& named) {
                           return named.param.name;
                         });

TEST(StereoRectifier, WidensTheViewOfABarrelLensAndNotOfAPinhole) {
  const double barrel = StereoRectifier(WarehouseRig()).stereo().camera.fx;
  EXPECT_LT(barrel, 0.98 * 457.418);
  EXPECT_GT(barrel, 0.90 * 457.418);
  EXPECT_NEAR(StereoRectifier(TurnedPinholeRig()).stereo().camera.fx, 457.41775, 1e-9);
}

TEST(StereoRectifier, MasksWhereATurnedCameraSeesNothing) {
  const StereoRectifier rectifier(TurnedPinholeRig());
  ASSERT_FALSE(rectifier.right_mask().empty());
  EXPECT_GT(cv::countNonZero(rectifier.right_mask() == 0), 1000);
}

TEST(StereoRectifier, PassesRectifiedImagesThrough) {
  StereoRig rig;
  rig.left.camera.pinhole = {718.856, 718.856, 607.1928, 185.2157, 1241, 376};
  rig.right.camera = rig.left.camera;
  rig.right.body_from_cam.translation.x() = 0.537;
  rig.already_rectified = true;
  const StereoRectifier rectifier(rig);
  cv::Mat image(376, 1241, CV_8UC1);
  cv::randu(image, 0, 256);
  EXPECT_EQ(cv::norm(rectifier.RectifyLeft(image), image, cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(rectifier.RectifyRight(image), image, cv::NORM_INF), 0);
  EXPECT_TRUE(rectifier.left_mask().empty());
  EXPECT_EQ(rectifier.stereo().camera.cx, 607.1928);
  EXPECT_NEAR(rectifier.stereo().baseline, 0.537, 1e-12);
  rig.right.camera.pinhole.cx += 1;
  EXPECT_THAT(ErrorOf([&] { StereoRectifier{rig}; }), HasSubstr("its two cameras differ"));
}

TEST(StereoRectifier, SaysWhatIsWrongWithTheRig) {
  const auto error_of = [](const StereoRig& rig) { return ErrorOf([&] { StereoRectifier{rig}; }); };
  StereoRig rig = WarehouseRig();
  std::swap(rig.left, rig.right);
  EXPECT_THAT(error_of(rig), HasSubstr("stands left of the left one (0.110 m)"));

  const auto moved = [](const Rigid3& left_from_right) {
    StereoRig r = WarehouseRig();
    r.right.body_from_cam = r.left.body_from_cam * left_from_right;
    return r;
  };
  const Eigen::Quaterniond same = Eigen::Quaterniond::Identity();
  EXPECT_EQ(error_of(moved({same, {0.1, 0.02, 0}})), "");
  EXPECT_THAT(error_of(moved({same, {0.01, 0.1, 0}})), HasSubstr("stands below the left one"));
  EXPECT_THAT(error_of(moved({same, {0.01, -0.1, 0}})), HasSubstr("stands above the left one"));
  EXPECT_THAT(error_of(moved({same, {0, 0, 0.1}})), HasSubstr("in front of the left one"));
  EXPECT_THAT(error_of(moved({same, {0, 0, -0.1}})), HasSubstr("behind the left one"));
  EXPECT_THAT(error_of(moved({same, {0, 0, 0}})), HasSubstr("stand at the same place"));
  EXPECT_THAT(error_of(moved({ExpSO3({0, 1.6, 0}), {0.1, 0, 0}})), HasSubstr("92 degrees apart"));
}

TEST(StereoRectifier, RefusesImagesOfAnotherSizeOrType) {
  const StereoRectifier rectifier(WarehouseRig());
  EXPECT_THAT(ErrorOf([&] { rectifier.RectifyLeft(cv::Mat::zeros(480, 640, CV_8UC1)); }),
              HasSubstr("the left image has 640x480 pixels, but the calibration says 752x480"));
  EXPECT_THAT(ErrorOf([&] { rectifier.RectifyRight(cv::Mat::zeros(480, 752, CV_16UC1)); }),
              HasSubstr("the right image is not 8-bit grey"));
}

}  // namespace
}  // namespace airslam
