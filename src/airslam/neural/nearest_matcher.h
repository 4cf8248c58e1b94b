// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "airslam/neural/feature_matcher.h"

namespace airslam {

struct NearestMatcherOptions {
  float min_cosine = 0.0F;  // -1..1: matched descriptors are at least so similar
  // 0..1: a match's squared distance is at most this share of the squared distance to the second
  // nearest in the other image (Lowe's ratio, squared, in both directions). 1 is no such test.
  float max_squared_ratio = 1.0F;

  // Throws Error that names the wrong field.
  void Validate() const;
};

// Mutual nearest neighbours by the cosine of unit-length descriptors. A match's score is the
// cosine. Of equally near neighbours the one with the smaller index counts.
class NearestMatcher : public FeatureMatcher {
 public:
  explicit NearestMatcher(const NearestMatcherOptions& options = {});

  // Throws Error when descriptors and keypoints differ in number, or the two descriptor sizes.
  std::vector<airslam::Match> Match(const MatcherInput& image0,
                                    const MatcherInput& image1) override;

 private:
  NearestMatcherOptions options_;
  DescriptorMatrix cosines_;  // N0 x N1, kept to save its allocation
};

}  // namespace airslam
