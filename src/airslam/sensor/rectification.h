// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>

#include "airslam/geometry/pinhole.h"
#include "airslam/geometry/rigid3.h"
#include "airslam/sensor/rig.h"

namespace airslam {

// Turns raw stereo pairs into rectified ones (rows correspond, one pinhole camera for both).
//
// Rectification rotates the cameras, so the extrinsic rotates with them:
// body_from_rectified = body_from_raw * R_rect^T, where R_rect = rectified_from_raw.
class StereoRectifier {
 public:
  // Throws Error when the rig cannot be rectified (no baseline, cameras that face apart).
  // The rectified images have the size of the raw left image.
  explicit StereoRectifier(const StereoRig& rig);

  // CV_8UC1 raw image of the calibrated size -> CV_8UC1 rectified image. Throws on another size.
  // Thread-safe.
  cv::Mat RectifyLeft(const cv::Mat& raw) const;
  cv::Mat RectifyRight(const cv::Mat& raw) const;

  // CV_8UC1, 255 where a rectified pixel has a source in the raw image, else 0. Empty when every
  // pixel has one.
  const cv::Mat& left_mask() const { return left_mask_; }
  const cv::Mat& right_mask() const { return right_mask_; }

  const StereoCamera& stereo() const { return stereo_; }
  // Rectified left camera to body.
  const Rigid3& body_from_left() const { return body_from_left_; }

 private:
  StereoCamera stereo_;
  Rigid3 body_from_left_;
  bool identity_ = false;  // already rectified: images pass through
  cv::Mat left_map_x_, left_map_y_, right_map_x_, right_map_y_;
  cv::Mat left_mask_, right_mask_;
};

}  // namespace airslam
