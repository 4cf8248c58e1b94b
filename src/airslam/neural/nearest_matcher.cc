// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/neural/nearest_matcher.h"

#include <cstddef>
#include <utility>

#include "airslam/common/error.h"

namespace airslam {
namespace {

// The largest and the second largest value, and where the largest is first reached.
struct Nearest {
  int index = -1;
  float best = -2;    // below every cosine
  float second = -2;  // stays there when there is no second

  void Offer(int candidate, float cosine) {
    if (cosine > best) {
      second = best;
      best = cosine;
      index = candidate;
    } else if (cosine > second) {
      second = cosine;
    }
  }
};

// Of unit vectors: |a - b|^2 = 2 - 2 cos.
bool PassesRatio(const Nearest& nearest, float max_squared_ratio) {
  if (max_squared_ratio >= 1 || nearest.second < -1.5F) return true;
  return 1 - nearest.best <= max_squared_ratio * (1 - nearest.second);
}

}  // namespace

void NearestMatcherOptions::Validate() const {
  if (!(min_cosine >= -1 && min_cosine <= 1)) {
    Fail("min_cosine is {}, expected -1 to 1", min_cosine);
  }
  if (!(max_squared_ratio >= 0 && max_squared_ratio <= 1)) {
    Fail("max_squared_ratio is {}, expected 0 to 1", max_squared_ratio);
  }
}

NearestMatcher::NearestMatcher(const NearestMatcherOptions& options) : options_(options) {
  options_.Validate();
}

std::vector<airslam::Match> NearestMatcher::Match(const MatcherInput& image0,
                                                  const MatcherInput& image1) {
  CheckMatcherInputs(image0, image1);
  const auto n0 = static_cast<int>(image0.keypoints.size());
  const auto n1 = static_cast<int>(image1.keypoints.size());
  std::vector<airslam::Match> matches;
  if (n0 == 0 || n1 == 0) return matches;
  cosines_.noalias() = image0.descriptors * image1.descriptors.transpose();
  std::vector<Nearest> of0(static_cast<std::size_t>(n0)), of1(static_cast<std::size_t>(n1));
  for (int i = 0; i < n0; ++i) {
    const float* row = cosines_.data() + static_cast<std::ptrdiff_t>(i) * n1;
    Nearest& nearest = of0[static_cast<std::size_t>(i)];
    for (int j = 0; j < n1; ++j) {
      nearest.Offer(j, row[j]);
      of1[static_cast<std::size_t>(j)].Offer(i, row[j]);
    }
  }
  for (int i = 0; i < n0; ++i) {
    const Nearest& forth = of0[static_cast<std::size_t>(i)];
    if (forth.index < 0 || forth.best < options_.min_cosine) continue;
    const Nearest& back = of1[static_cast<std::size_t>(forth.index)];
    if (back.index != i || !PassesRatio(forth, options_.max_squared_ratio) ||
        !PassesRatio(back, options_.max_squared_ratio)) {
      continue;
    }
    matches.push_back({i, forth.index, forth.best});
  }
  return matches;
}

}  // namespace airslam
