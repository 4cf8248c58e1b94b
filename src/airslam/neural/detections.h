// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include <memory>
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
  float score = 0;  // PLNet's: the probability that it is a line, 0..1
};

// Stands for a line that is not there.
inline constexpr LineSegment kNoLine{0, 0, 0, 0, -1};

// The two junctions that are a line's ends, as indices of Detections::junctions.
struct LineEnds {
  int start = -1;  // at x1, y1
  int end = -1;    // at x2, y2
};

struct ImageMaps;

// What PLNet sees in one image (paper, section IV-B).
struct Detections {
  std::vector<Keypoint> keypoints;  // best score first, ties by row, then column
  DescriptorMatrix descriptors;     // keypoints.size() x D, rows of unit length
  // The rest is filled when lines are asked for and the network finds lines.
  std::vector<LineSegment> lines;         // best score first, ties by their ends
  std::vector<LineEnds> line_ends;        // of each line
  std::vector<Keypoint> junctions;        // the ends of these lines; score: probability, 0..1
  DescriptorMatrix junction_descriptors;  // junctions.size() x D, rows of unit length
  // What FeatureDetector::FindLines needs of the image; null unless asked for.
  std::shared_ptr<const ImageMaps> maps;
};

// A correspondence between keypoint `index0` of one image and `index1` of another.
struct Match {
  int index0 = -1;
  int index1 = -1;
  float score = 0;
};

}  // namespace airslam
