// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include <span>
#include <vector>

#include "airslam/feature/keypoint_grid.h"
#include "airslam/neural/detections.h"

namespace airslam {

// A feature of a keyframe together with where it is expected in the current image.
struct Expectation {
  int index = -1;  // row of `expected_descriptors`
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
};

struct GuidedMatchingOptions {
  double radius = 40;           // pixels around the expectation
  double min_similarity = 0.6;  // cosine of the descriptors
};

// Matches expectations to keypoints by descriptor within a radius, one to one: of several
// expectations that like one keypoint best the most similar wins. Match::index0 is
// Expectation::index. Ordered by index1.
std::vector<Match> MatchExpectations(std::span<const Expectation> expectations,
                                     const DescriptorMatrix& expected_descriptors,
                                     const KeypointGrid& grid, const DescriptorMatrix& descriptors,
                                     const GuidedMatchingOptions& options);

}  // namespace airslam
