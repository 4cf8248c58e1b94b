// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "airslam/sensor/rig.h"

namespace airslam {

// The body of the first two rigs is an IMU as EuRoC's: x up, y right, z forward, some centimetres
// away from the cameras. Sizes of images in pixels; the field of view stays the same.

// Two equal, parallel cameras without distortion (rectified already), fx != fy, baseline 0.11 m.
StereoRig IdealRig(int width = 752, int height = 480);

// As EuRoC's: radial-tangential distortion, different cameras, the right one turned by about 1
// degree, baseline about 0.11 m.
StereoRig EurocLikeRig(int width = 752, int height = 480);

// As KITTI's: rectified, baseline 0.5 m, no IMU; the body is the left camera.
StereoRig KittiLikeRig(int width = 752, int height = 480);

// The rotation heading_from_body with which the left camera looks along the heading frame's x
// (forward), level (heading frame: x forward, y left, z up).
Eigen::Quaterniond HeadingFromBody(const StereoRig& rig);

}  // namespace airslam
