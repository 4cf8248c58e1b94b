// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/bound_scale.h"

#include <algorithm>
#include <cmath>

namespace airslam {

double BoundScale(std::vector<double> mean_squares, double lost_freedom, double least) {
  if (least >= 1 || mean_squares.empty()) return 1;
  constexpr double kTails = 1.5;
  constexpr double kMedian = 0.75;  // of the mean of two to four squares of unit variance
  const auto middle = mean_squares.begin() + static_cast<std::ptrdiff_t>(mean_squares.size() / 2);
  std::nth_element(mean_squares.begin(), middle, mean_squares.end());
  return std::clamp(kTails * std::sqrt(*middle / kMedian * lost_freedom), least, 1.0);
}

}  // namespace airslam
