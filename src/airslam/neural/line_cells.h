// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <cstddef>

#include "airslam/neural/line_decoder.h"

namespace airslam {

// What the decoders of a network's line maps share.

inline float Sigmoid(float x) { return 1 / (1 + std::exp(-x)); }

inline float Logit(float probability) { return std::log(probability / (1 - probability)); }

inline float Distance(const Keypoint& p, const Keypoint& q) {
  return std::sqrt((p.x - q.x) * (p.x - q.x) + (p.y - q.y) * (p.y - q.y));
}

// Pixel of the centre of a cell.
inline float Centre(int cell, int stride) {
  return static_cast<float>(cell * stride) + static_cast<float>(stride - 1) / 2;
}

// Cells of a map.
inline std::ptrdiff_t Plane(const LineMaps& maps) {
  return static_cast<std::ptrdiff_t>(maps.width) * maps.height;
}

}  // namespace airslam
