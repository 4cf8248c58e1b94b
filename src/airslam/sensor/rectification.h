// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include "airslam/geometry/pinhole.h"
#include "airslam/geometry/rigid3.h"
#include "airslam/sensor/rig.h"

namespace airslam {

// Turns raw stereo pairs into rectified ones (rows correspond, one pinhole camera for both).
//
// Both cameras are turned so that x runs along the baseline and z lies half-way between the two
// raw optical axes. The focal length is the mean of the raw ones, or up to 10 % less as long as 99
// % of the pixels of both images have a source: the field of view is kept rather than cropped to
// the valid part, and what has no source is masked. The principal point is such that the borders of
// the raw images come to lie centrally.
//
// Rectification rotates the cameras, so the extrinsic rotates with them:
// body_from_rectified = body_from_raw * R_rect^T, where R_rect = rectified_from_raw.
class StereoRectifier {
 public:
  // Throws Error when the rig cannot be rectified: no baseline, cameras that face apart, the right
  // camera above, below, before or behind the left one, or left of it (swapped).
  // The rectified images have the size of the raw left image.
  explicit StereoRectifier(const StereoRig& rig);

  // CV_8UC1 raw image of the calibrated size -> CV_8UC1 rectified image. Throws on another size.
  // Thread-safe. Pixels outside the mask continue the raw image's border, so that no edge stands
  // where the image ends. When the rig is rectified already, the result shares the raw pixels.
  cv::Mat RectifyLeft(const cv::Mat& raw) const;
  cv::Mat RectifyRight(const cv::Mat& raw) const;

  // CV_8UC1, 255 where a rectified pixel has a source in the raw image, else 0. Empty when every
  // pixel has one.
  const cv::Mat& left_mask() const { return left_.mask; }
  const cv::Mat& right_mask() const { return right_.mask; }

  const StereoCamera& stereo() const { return stereo_; }
  // Rectified left camera to body.
  const Rigid3& body_from_left() const { return body_from_left_; }
  // R_rect of each camera: rectified_from_raw.
  const Eigen::Matrix3d& left_rotation() const { return left_.rectified_from_raw; }
  const Eigen::Matrix3d& right_rotation() const { return right_.rectified_from_raw; }

 private:
  struct View {
    Eigen::Matrix3d rectified_from_raw = Eigen::Matrix3d::Identity();
    cv::Size raw_size;
    cv::Mat map, map_fraction;  // of cv::remap: CV_16SC2 and CV_16UC1 (1/32 pixel)
    cv::Mat mask;
  };

  void BuildMaps(const DistortedCamera& raw, View* view) const;
  cv::Mat Rectify(const cv::Mat& raw, const View& view, const char* name) const;

  StereoCamera stereo_;
  Rigid3 body_from_left_;
  bool identity_ = false;  // already rectified: images pass through
  View left_, right_;
};

}  // namespace airslam
