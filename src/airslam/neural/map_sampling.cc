// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/neural/map_sampling.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace airslam {
namespace {

// Four cells of a map, as offsets in cells from its first, with their weights.
struct BilinearTap {
  std::ptrdiff_t top, bottom;  // the left cells
  std::ptrdiff_t right;        // step to the right cells
  float w00, w01, w10, w11;    // top left, top right, bottom left, bottom right
};

BilinearTap MakeTap(float pixel_x, float pixel_y, const FeatureMap& map, bool half_pixel) {
  const auto s = static_cast<float>(map.stride);
  const auto cell = [&](float pixel, int size) {
    const float c = half_pixel ? (pixel + 0.5F) / s - 0.5F : pixel / s;
    return std::clamp(c, 0.0F, static_cast<float>(size - 1));
  };
  const float x = cell(pixel_x, map.width), y = cell(pixel_y, map.height);
  const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
  const float ax = x - static_cast<float>(x0), ay = y - static_cast<float>(y0);
  const int y1 = std::min(y0 + 1, map.height - 1);
  return {static_cast<std::ptrdiff_t>(y0) * map.width + x0,
          static_cast<std::ptrdiff_t>(y1) * map.width + x0,
          x0 + 1 < map.width ? 1 : 0,
          (1 - ax) * (1 - ay),
          ax * (1 - ay),
          (1 - ax) * ay,
          ax * ay};
}

// All channels of one sample of a map in cells.
void SampleCells(const FeatureMap& map, const BilinearTap& tap, float* out) {
  const std::ptrdiff_t channels = map.channels;
  const float* top = map.data + tap.top * channels;
  const float* bottom = map.data + tap.bottom * channels;
  const float* top_right = top + tap.right * channels;
  const float* bottom_right = bottom + tap.right * channels;
  for (std::ptrdiff_t k = 0; k < channels; ++k) {
    out[k] =
        tap.w00 * top[k] + tap.w01 * top_right[k] + tap.w10 * bottom[k] + tap.w11 * bottom_right[k];
  }
}

// One channel after the other: a plane of the map fits into the cache, the whole map does not.
void SamplePlanes(const FeatureMap& map, std::span<const BilinearTap> taps, float* out,
                  int row_stride) {
  for (int channel = 0; channel < map.channels; ++channel) {
    const float* plane = map.data + static_cast<std::ptrdiff_t>(channel) * map.width * map.height;
    float* value = out + channel;
    for (const BilinearTap& tap : taps) {
      const float* top = plane + tap.top;
      const float* bottom = plane + tap.bottom;
      *value = tap.w00 * top[0] + tap.w01 * top[tap.right] + tap.w10 * bottom[0] +
               tap.w11 * bottom[tap.right];
      value += row_stride;
    }
  }
}

// kStride 0: the map's.
template <std::ptrdiff_t kStride>
void Unfold(const FeatureMap& scores, float* plane) {
  const std::ptrdiff_t stride = kStride > 0 ? kStride : scores.stride;
  const std::ptrdiff_t width = scores.width * stride;
  const float* cell = scores.data;
  for (int y = 0; y < scores.height; ++y, plane += stride * width) {
    for (int x = 0; x < scores.width; ++x) {
      for (std::ptrdiff_t row = 0; row < stride; ++row, cell += stride) {
        std::copy_n(cell, stride, plane + row * width + x * stride);
      }
    }
  }
}

}  // namespace

void SampleAtKeypoints(const FeatureMap& map, std::span<const Keypoint> keypoints, bool half_pixel,
                       float* out, int row_stride) {
  std::vector<BilinearTap> taps;
  taps.reserve(keypoints.size());
  for (const Keypoint& k : keypoints) taps.push_back(MakeTap(k.x, k.y, map, half_pixel));
  if (map.layout == MapLayout::kPlanes) return SamplePlanes(map, taps, out, row_stride);
  for (const BilinearTap& tap : taps) {
    SampleCells(map, tap, out);
    out += row_stride;
  }
}

void PoolAlongLine(const FeatureMap& map, const Keypoint& start, const Keypoint& end, int samples,
                   float* out) {
  for (int i = 0; i < samples; ++i, out += map.channels) {
    const float t = static_cast<float>(i) / static_cast<float>(samples - 1);
    const float x = start.x + t * (end.x - start.x), y = start.y + t * (end.y - start.y);
    SampleCells(map, MakeTap(x, y, map, true), out);
  }
}

void PoolAtEnd(const FeatureMap& map, const Keypoint& start, const Keypoint& end,
               std::span<const float> offsets, float* out) {
  const float x = end.x - start.x, y = end.y - start.y;
  const float length = std::max(std::sqrt(x * x + y * y), 1e-12F);
  for (const float offset : offsets) {
    const float t = offset / length;
    SampleCells(map, MakeTap(start.x + t * x, start.y + t * y, map, true), out);
    out += map.channels;
  }
}

void UnfoldCells(const FeatureMap& scores, float* plane) {
  // Known when it is compiled, a row of a cell is one move instead of a call.
  if (scores.stride == 4) return Unfold<4>(scores, plane);
  if (scores.stride == 8) return Unfold<8>(scores, plane);
  Unfold<0>(scores, plane);
}

}  // namespace airslam
