// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>

#include "airslam/neural/detections.h"

namespace airslam {

// Where the channels of a map stand.
enum class MapLayout {
  kPlanes,  // a plane of height x width values for each channel: 1xCxhxw
  kCells,   // all channels of a cell side by side, cell after cell: (h w)xC
};

// A map that a network has computed of an image; somebody else owns the values.
struct FeatureMap {
  const float* data = nullptr;
  int width = 0, height = 0;  // cells
  int channels = 0;
  int stride = 1;  // pixels a cell
  MapLayout layout = MapLayout::kCells;
};

// Bilinear samples of a map at keypoints: row i of `out`, which starts at out + i * row_stride,
// gets the map's channels. Pixel x lies at cell (x + 0.5) / stride - 0.5 with half_pixel, else at
// x / stride; positions outside the map are clamped to it.
void SampleAtKeypoints(const FeatureMap& map, std::span<const Keypoint> keypoints, bool half_pixel,
                       float* out, int row_stride);

// Line-of-interest pooling: `samples` bilinear samples (>= 2) at equal steps from end to end of a
// map in cells, with half_pixel positions, clamped to it. out: samples * channels floats, one
// sample after the other.
void PoolAlongLine(const FeatureMap& map, const Keypoint& start, const Keypoint& end, int samples,
                   float* out);

// The same at places on the endless line through both ends, `offsets` pixels from `start` towards
// `end`. out: offsets.size() * channels floats.
void PoolAtEnd(const FeatureMap& map, const Keypoint& start, const Keypoint& end,
               std::span<const float> offsets, float* out);

// Scores of a map in cells, stride^2 channels (those of a cell's pixels, row by row), as one plane
// of (height * stride) x (width * stride) values.
void UnfoldCells(const FeatureMap& scores, float* plane);

}  // namespace airslam
