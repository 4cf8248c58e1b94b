// SPDX-License-Identifier: BSD-3-Clause
//
// The arrays of a keyframe as the BLOBs of a map file: little-endian, one element after the other,
// nothing else. docs/map_format.md is the reference.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "airslam/map/keyframe.h"

namespace airslam {

using Bytes = std::vector<std::byte>;

// Array of float32, float64, uint16 or int64. Decoding throws Error when the size is not a whole
// number of elements.
template <class T>
Bytes EncodeArray(std::span<const T> values);
template <class T>
std::vector<T> DecodeArray(std::span<const std::byte> blob);

// x, y, score a keypoint; x1, y1, x2, y2, score a line; float32 each.
Bytes EncodeKeypoints(std::span<const Keypoint> keypoints);
std::vector<Keypoint> DecodeKeypoints(std::span<const std::byte> blob);
Bytes EncodeLines(std::span<const LineSegment> lines);
std::vector<LineSegment> DecodeLines(std::span<const std::byte> blob);

// Readings of the IMU, 32 bytes each: int64 nanoseconds, then angular velocity (rad/s) and
// acceleration (m/s^2) as 6 float32, to which they are rounded.
Bytes EncodeImuSamples(std::span<const ImuSample> samples);
std::vector<ImuSample> DecodeImuSamples(std::span<const std::byte> blob);

// Descriptors as int8, row after row: value = scale * int8, one scale a matrix, chosen so that the
// largest magnitude becomes 127.
struct QuantizedDescriptors {
  Bytes values;
  double scale = 0;
};

// `descriptors`: N x D, finite (else Error), rows of unit length.
QuantizedDescriptors QuantizeDescriptors(const DescriptorMatrix& descriptors);

// `rows` x D, rows brought back to unit length; D follows from the size. Each component is within
// 1/127 of the original. Throws Error when the size is not a whole number of rows.
DescriptorMatrix RestoreDescriptors(std::span<const std::byte> values, double scale, int rows);

}  // namespace airslam
