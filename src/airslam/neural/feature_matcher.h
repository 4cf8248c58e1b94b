// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>

#include <span>
#include <vector>

#include "airslam/neural/detections.h"

namespace airslam {

// One image's features as a matcher takes them. The data must outlive the call.
struct MatcherInput {
  std::span<const Keypoint> keypoints;
  const DescriptorMatrix& descriptors;  // keypoints.size() x D
  cv::Size image_size;
};

// Throws Error unless every keypoint has a descriptor and the descriptors have one size.
void CheckMatcherInputs(const MatcherInput& image0, const MatcherInput& image1);

// Finds correspondences between the features of two images, one to one, ordered by index0.
// One instance is used by one thread at a time; the result depends on the arguments only.
class FeatureMatcher {
 public:
  virtual ~FeatureMatcher() = default;
  virtual std::vector<airslam::Match> Match(const MatcherInput& image0,
                                            const MatcherInput& image1) = 0;
};

}  // namespace airslam
