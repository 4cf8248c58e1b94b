// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/bias_walk_factor.h"

#include <algorithm>
#include <cmath>

namespace airslam {

BiasWalkFactor::BiasWalkFactor(const ImuNoise& noise, double duration) {
  const double root = std::sqrt(std::max(duration, 0.0));
  gyroscope_weight_ = 1 / std::max(noise.gyroscope_random_walk * root, kMinSigmaGyroscope);
  accelerometer_weight_ =
      1 / std::max(noise.accelerometer_random_walk * root, kMinSigmaAccelerometer);
}

bool BiasWalkFactor::Evaluate(double const* const* parameters, double* residuals,
                              double** jacobians) const {
  for (int block = 0; jacobians != nullptr && block < 2; ++block) {
    if (jacobians[block] != nullptr) std::fill_n(jacobians[block], 36, 0.0);
  }
  for (int i = 0; i < 6; ++i) {
    const double weight = i < 3 ? gyroscope_weight_ : accelerometer_weight_;
    residuals[i] = weight * (parameters[1][i] - parameters[0][i]);
    if (jacobians == nullptr) continue;
    if (jacobians[0] != nullptr) jacobians[0][7 * i] = -weight;
    if (jacobians[1] != nullptr) jacobians[1][7 * i] = weight;
  }
  return true;
}

}  // namespace airslam
