// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/sensor/rectification.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "airslam/common/error.h"

namespace airslam {
namespace {

constexpr double kMinBaseline = 1e-4;    // m
constexpr double kMinAxesCosine = 0.5;   // the optical axes are at most 60 degrees apart
constexpr double kMinValidShare = 0.25;  // of a rectified image
// The view is widened in small steps while every pixel keeps its source, but not by more.
constexpr double kMinZoom = 0.9;  // of the mean raw focal length
constexpr double kZoomStep = 0.005;

// The common orientation of the rectified cameras. Columns: x, y, z of the rectified camera in
// body.
Eigen::Matrix3d RectifiedAxes(const StereoRig& rig) {
  const Eigen::Matrix3d left = rig.left.body_from_cam.rotation.toRotationMatrix();
  const Eigen::Matrix3d right = rig.right.body_from_cam.rotation.toRotationMatrix();
  const Eigen::Vector3d baseline =
      rig.right.body_from_cam.translation - rig.left.body_from_cam.translation;
  if (!(baseline.norm() > kMinBaseline)) {
    Fail("the two cameras of the calibration stand at the same place (baseline {:.6f} m)",
         baseline.norm());
  }
  if (!(left.col(2).dot(right.col(2)) > kMinAxesCosine)) {
    Fail(
        "the two cameras of the calibration face apart (their axes are {:.0f} degrees apart), so "
        "they cannot be rectified",
        std::acos(left.col(2).dot(right.col(2))) * 180 / 3.14159265358979323846);
  }

  // The baseline in a camera half-way between the two.
  const Eigen::Vector3d in_left = left.transpose() * baseline;
  const Eigen::Vector3d in_right = right.transpose() * baseline;
  const Eigen::Vector3d direction = (in_left + in_right).normalized();
  if (std::abs(direction.x()) < std::sqrt(0.5)) {
    const bool vertical = std::abs(direction.y()) > std::abs(direction.z());
    const char* side = vertical ? (direction.y() > 0 ? "below" : "above")
                                : (direction.z() > 0 ? "in front of" : "behind");
    Fail(
        "the right camera of the calibration stands {} the left one ({:.3f} m), but only cameras "
        "side by side can be rectified",
        side, baseline.norm());
  }
  if (direction.x() < 0) {
    Fail(
        "the right camera of the calibration stands left of the left one ({:.3f} m): the cameras "
        "are swapped or an extrinsic is inverted",
        baseline.norm());
  }

  Eigen::Matrix3d axes;
  axes.col(0) = baseline.normalized();
  axes.col(1) = (left.col(2) + right.col(2)).cross(axes.col(0)).normalized();
  axes.col(2) = axes.col(0).cross(axes.col(1));
  return axes;
}

// The mean of the raw image's border on the plane z = 1 of the rectified camera. Parts of the
// border that the lens does not reach are left out.
Eigen::Vector2d BorderCentre(const DistortedCamera& raw,
                             const Eigen::Matrix3d& rectified_from_raw) {
  constexpr int kSteps = 16;
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  int count = 0;
  const auto add = [&](double x, double y) {
    Eigen::Vector3d ray;
    if (!raw.Unproject({x, y}, &ray)) return;
    ray = rectified_from_raw * ray;
    // A border that lies too far aside says nothing about where the centre should be.
    if (ray.z() <= 0 || ray.hnormalized().norm() > 2) return;
    sum += ray.hnormalized();
    ++count;
  };
  const double right = raw.pinhole.width - 1, bottom = raw.pinhole.height - 1;
  for (int i = 0; i < kSteps; ++i) {
    const double t = (i + 0.5) / kSteps;
    add(t * right, 0);
    add(t * right, bottom);
    add(0, t * bottom);
    add(right, t * bottom);
  }
  if (count > 0) return sum / count;
  const Eigen::Vector3d axis = rectified_from_raw.col(2);
  return axis.hnormalized();
}

// One camera on its way from raw to rectified.
struct Turned {
  const DistortedCamera& raw;
  Eigen::Matrix3d raw_from_rectified;
  double max_radius;

  Turned(const DistortedCamera& camera, const Eigen::Matrix3d& rectified_from_raw)
      : raw(camera),
        raw_from_rectified(rectified_from_raw.transpose()),
        max_radius(camera.MaxRadius()) {}

  // The raw pixel that a rectified one shows; (-1, -1) where the lens shows nothing.
  Eigen::Vector2d RawPixel(const Pinhole& rectified, const Eigen::Vector2d& pixel) const {
    const Eigen::Vector3d ray = raw_from_rectified * rectified.Unproject(pixel);
    if (ray.z() <= 0 || ray.hnormalized().norm() >= max_radius) return {-1, -1};
    return raw.Project(ray);
  }

  // Whether every rectified pixel has a source; looks at a grid that includes the border.
  bool AllValid(const Pinhole& rectified) const {
    constexpr int kSteps = 64;
    for (int i = 0; i <= kSteps; ++i) {
      for (int j = 0; j <= kSteps; ++j) {
        const Eigen::Vector2d pixel(j * (rectified.width - 1.0) / kSteps,
                                    i * (rectified.height - 1.0) / kSteps);
        if (!raw.pinhole.Contains(RawPixel(rectified, pixel))) return false;
      }
    }
    return true;
  }
};

// The pinhole camera that both rectified images share, see the class's comment.
Pinhole RectifiedCamera(const StereoRig& rig, const Eigen::Matrix3d& left_rotation,
                        const Eigen::Matrix3d& right_rotation) {
  const Pinhole& left = rig.left.camera.pinhole;
  const Pinhole& right = rig.right.camera.pinhole;
  const double mean_focal = 0.25 * (left.fx + left.fy + right.fx + right.fy);
  const Eigen::Vector2d centre = 0.5 * (BorderCentre(rig.left.camera, left_rotation) +
                                        BorderCentre(rig.right.camera, right_rotation));
  const auto camera_of = [&](double zoom) {
    const double focal = zoom * mean_focal;
    const Eigen::Vector2d principal =
        0.5 * Eigen::Vector2d(left.width - 1, left.height - 1) - focal * centre;
    return Pinhole{focal, focal, principal.x(), principal.y(), left.width, left.height};
  };
  const Turned turned_left(rig.left.camera, left_rotation);
  const Turned turned_right(rig.right.camera, right_rotation);
  Pinhole camera = camera_of(1);
  for (int i = 1; 1 - i * kZoomStep > kMinZoom - 1e-9; ++i) {
    const Pinhole wider = camera_of(1 - i * kZoomStep);
    if (!turned_left.AllValid(wider) || !turned_right.AllValid(wider)) break;
    camera = wider;
  }
  return camera;
}

bool SameCamera(const Pinhole& a, const Pinhole& b) {
  return a.fx == b.fx && a.fy == b.fy && a.cx == b.cx && a.cy == b.cy && a.width == b.width &&
         a.height == b.height;
}

}  // namespace

StereoRectifier::StereoRectifier(const StereoRig& rig) {
  const Eigen::Matrix3d body_from_rectified = RectifiedAxes(rig);
  const Pinhole& left = rig.left.camera.pinhole;
  const Pinhole& right = rig.right.camera.pinhole;
  left_.raw_size = cv::Size(left.width, left.height);
  right_.raw_size = cv::Size(right.width, right.height);
  stereo_.baseline = rig.Baseline();

  if (rig.already_rectified) {
    if (!SameCamera(left, right)) {
      Fail("the calibration says that the images are rectified, but its two cameras differ");
    }
    identity_ = true;
    stereo_.camera = left;
    body_from_left_ = rig.left.body_from_cam;
    return;
  }

  left_.rectified_from_raw = body_from_rectified.transpose() * rig.left.body_from_cam.rotation;
  right_.rectified_from_raw = body_from_rectified.transpose() * rig.right.body_from_cam.rotation;
  body_from_left_ = Rigid3(
      rig.left.body_from_cam.rotation * Eigen::Quaterniond(left_.rectified_from_raw).conjugate(),
      rig.left.body_from_cam.translation);

  stereo_.camera = RectifiedCamera(rig, left_.rectified_from_raw, right_.rectified_from_raw);
  BuildMaps(rig.left.camera, &left_);
  BuildMaps(rig.right.camera, &right_);
}

void StereoRectifier::BuildMaps(const DistortedCamera& raw, View* view) const {
  const Pinhole& camera = stereo_.camera;
  const cv::Size size(camera.width, camera.height);
  cv::Mat map_x(size, CV_32FC1), map_y(size, CV_32FC1);
  view->mask.create(size, CV_8UC1);
  const Turned turned(raw, view->rectified_from_raw);
  for (int v = 0; v < size.height; ++v) {
    for (int u = 0; u < size.width; ++u) {
      const Eigen::Vector2d pixel = turned.RawPixel(camera, Eigen::Vector2d(u, v));
      map_x.at<float>(v, u) = static_cast<float>(pixel.x());
      map_y.at<float>(v, u) = static_cast<float>(pixel.y());
      view->mask.at<uchar>(v, u) = raw.pinhole.Contains(pixel) ? 255 : 0;
    }
  }
  const int valid = cv::countNonZero(view->mask);
  if (valid < kMinValidShare * size.area()) {
    Fail(
        "only {:.0f} % of a rectified image would show anything: the two cameras of the "
        "calibration look too differently, or its numbers are wrong",
        100.0 * valid / size.area());
  }
  if (valid == size.area()) view->mask.release();
  // Maps of fixed point numbers are as exact (remap rounds to 1/32 pixel anyway) and faster.
  cv::convertMaps(map_x, map_y, view->map, view->map_fraction, CV_16SC2);
}

cv::Mat StereoRectifier::RectifyLeft(const cv::Mat& raw) const {
  return Rectify(raw, left_, "left");
}

cv::Mat StereoRectifier::RectifyRight(const cv::Mat& raw) const {
  return Rectify(raw, right_, "right");
}

cv::Mat StereoRectifier::Rectify(const cv::Mat& raw, const View& view, const char* name) const {
  if (raw.type() != CV_8UC1) Fail("the {} image is not 8-bit grey", name);
  if (raw.size() != view.raw_size) {
    Fail("the {} image has {}x{} pixels, but the calibration says {}x{}", name, raw.cols, raw.rows,
         view.raw_size.width, view.raw_size.height);
  }
  if (identity_) return raw;
  cv::Mat rectified;
  cv::remap(raw, rectified, view.map, view.map_fraction, cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  return rectified;
}

}  // namespace airslam
