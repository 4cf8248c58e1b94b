// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/neural/feature_matcher.h"

#include "airslam/common/error.h"

namespace airslam {

void CheckMatcherInputs(const MatcherInput& image0, const MatcherInput& image1) {
  for (const MatcherInput* image : {&image0, &image1}) {
    const auto keypoints = static_cast<Eigen::Index>(image->keypoints.size());
    if (image->descriptors.rows() != keypoints) {
      Fail("the matcher was given {} keypoints but {} descriptors", keypoints,
           image->descriptors.rows());
    }
  }
  if (!image0.keypoints.empty() && !image1.keypoints.empty() &&
      image0.descriptors.cols() != image1.descriptors.cols()) {
    Fail("the matcher was given descriptors of {} and of {} values", image0.descriptors.cols(),
         image1.descriptors.cols());
  }
}

}  // namespace airslam
