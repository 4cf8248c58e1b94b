// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/feature/guided_matching.h"

namespace airslam {

std::vector<Match> MatchExpectations(std::span<const Expectation> expectations,
                                     const DescriptorMatrix& expected_descriptors,
                                     const KeypointGrid& grid, const DescriptorMatrix& descriptors,
                                     const GuidedMatchingOptions& options) {
  std::vector<Match> best_of_keypoint(descriptors.rows());
  for (const Expectation& expectation : expectations) {
    const auto expected = expected_descriptors.row(expectation.index);
    Match best{expectation.index, -1, static_cast<float>(options.min_similarity)};
    grid.VisitNear(expectation.pixel, options.radius, [&](int index) {
      const float similarity = expected.dot(descriptors.row(index));
      if (similarity > best.score) {
        best.index1 = index;
        best.score = similarity;
      }
    });
    if (best.index1 < 0) continue;
    Match& taken = best_of_keypoint[best.index1];
    if (taken.index0 < 0 || best.score > taken.score) taken = best;
  }
  std::vector<Match> matches;
  for (const Match& match : best_of_keypoint) {
    if (match.index0 >= 0) matches.push_back(match);
  }
  return matches;
}

}  // namespace airslam
