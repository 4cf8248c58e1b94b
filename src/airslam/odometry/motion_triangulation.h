// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "airslam/geometry/pinhole.h"
#include "airslam/map/keyframe.h"

namespace airslam {

struct MotionTriangulationOptions {
  double max_epipolar_distance = 2.0;  // pixels, between detected keypoints
  double min_similarity = 0.75;        // cosine of the descriptors; no stereo row helps here
  double min_correlation = 0.8;        // of the aligned patches
  double min_parallax = 0.02;          // radians between the two rays
  double max_error = 1.0;              // pixels, of either ray
};

// A keyframe with its rectified left image, CV_8UC1.
struct KeyframeSight {
  const Keyframe& keyframe;
  const cv::Mat& image;
};

// A point that two keyframes see and neither has depth for.
struct MotionPoint {
  int earlier_index = -1;  // keypoints of the two
  int later_index = -1;
  Eigen::Vector2d later_pixel = Eigen::Vector2d::Zero();  // aligned to the earlier patch
  Eigen::Vector3d point_in_world = Eigen::Vector3d::Zero();
};

// Triangulates keypoints without a stereo match and without a landmark from two keyframes whose
// poses are known (paper, section V-C: "unmatched keypoints are triangulated leveraging multi-frame
// observations"): matched by descriptor along the epipolar line, mutually best, and aligned by
// patch. Ordered by earlier_index.
std::vector<MotionPoint> TriangulateFromMotion(const KeyframeSight& earlier,
                                               const KeyframeSight& later, const Pinhole& camera,
                                               const MotionTriangulationOptions& options = {});

}  // namespace airslam
