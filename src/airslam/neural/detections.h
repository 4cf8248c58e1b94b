// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include <vector>

namespace airslam {

// Row-major, so that a descriptor is contiguous.
using DescriptorMatrix = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// An interest point in pixels of the network's input image (integer = pixel centre).
struct Keypoint {
  float x = 0, y = 0;
  float score = 0;  // the network's, larger is better
};

// A line segment in pixels of the network's input image.
struct LineSegment {
  float x1 = 0, y1 = 0, x2 = 0, y2 = 0;
  float score = 0;
};

// What PLNet sees in one image (paper, section IV-B).
struct Detections {
  std::vector<Keypoint> keypoints;  // best score first, ties by row, then column
  DescriptorMatrix descriptors;     // keypoints.size() x D, rows of unit length
  std::vector<LineSegment> lines;   // empty until a pack has a line module
  std::vector<Keypoint> junctions;  // likewise
  DescriptorMatrix junction_descriptors;
};

// A correspondence between keypoint `index0` of one image and `index1` of another.
struct Match {
  int index0 = -1;
  int index1 = -1;
  float score = 0;
};

}  // namespace airslam
