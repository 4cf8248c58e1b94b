// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <nanobind/ndarray.h>

#include <Eigen/Core>
#include <cstddef>
#include <initializer_list>
#include <utility>
#include <vector>

#include "airslam/geometry/rigid3.h"
#include "airslam/neural/detections.h"

namespace airslam::python {

namespace nb = nanobind;

// A numpy array that owns its numbers; -1 stands for any length.
template <typename T, nb::ssize_t... Shape>
using Array = nb::ndarray<nb::numpy, T, nb::shape<Shape...>, nb::c_contig>;

using Matrix4Array = Array<double, 4, 4>;
using PixelArray = Array<float, -1, 2>;

// Hands numbers over to numpy, without a copy.
template <typename ArrayType, typename T>
ArrayType ToArray(std::vector<T> numbers, std::initializer_list<std::size_t> shape) {
  auto* owned = new std::vector<T>(std::move(numbers));
  nb::capsule owner(owned, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
  return ArrayType(owned->data(), shape, owner);
}

// Appends the numbers of a pose, row by row.
inline void AppendPose(const Rigid3& pose, std::vector<double>& numbers) {
  const Eigen::Matrix<double, 4, 4, Eigen::RowMajor> matrix = pose.ToMatrix();
  numbers.insert(numbers.end(), matrix.data(), matrix.data() + 16);
}

inline Matrix4Array ToArray(const Rigid3& pose) {
  std::vector<double> numbers;
  AppendPose(pose, numbers);
  return ToArray<Matrix4Array>(std::move(numbers), {4, 4});
}

inline PixelArray Pixels(const std::vector<Keypoint>& keypoints) {
  std::vector<float> numbers;
  for (const Keypoint& p : keypoints) numbers.insert(numbers.end(), {p.x, p.y});
  return ToArray<PixelArray>(std::move(numbers), {keypoints.size(), 2});
}

using FloatRows = Array<float, -1, -1>;

inline FloatRows Rows(const DescriptorMatrix& matrix) {
  return ToArray<FloatRows>(
      std::vector<float>(matrix.data(), matrix.data() + matrix.size()),
      {static_cast<std::size_t>(matrix.rows()), static_cast<std::size_t>(matrix.cols())});
}

}  // namespace airslam::python
