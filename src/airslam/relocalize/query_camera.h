// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>

#include "airslam/sensor/rectification.h"
#include "airslam/sensor/rig.h"

namespace airslam {

// The camera of query images: takes out the lens' distortion. The field of view is kept as
// rectification keeps it (StereoRectifier); the camera is not turned. Thread-safe.
class QueryCamera {
 public:
  // Throws Error when the calibration leaves hardly anything of the image.
  explicit QueryCamera(const RigCamera& camera);

  // CV_8UC1 raw image of the calibrated size -> the image that `pinhole` sees. Throws Error on
  // another size.
  cv::Mat Undistort(const cv::Mat& raw) const { return rectifier_.RectifyLeft(raw); }

  const Pinhole& pinhole() const { return rectifier_.stereo().camera; }
  // CV_8UC1, 0 where an undistorted pixel has no source; empty when all have one.
  const cv::Mat& mask() const { return rectifier_.left_mask(); }
  const Rigid3& body_from_cam() const { return rectifier_.body_from_left(); }

 private:
  StereoRectifier rectifier_;
};

}  // namespace airslam
