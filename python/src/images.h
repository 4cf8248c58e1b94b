// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <nanobind/ndarray.h>

#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>

#include "airslam/common/error.h"

namespace airslam::python {

// A grey image that Python hands over. Take it with noconvert(): numbers of another type would be
// cut to 8 bits in silence.
using GivenImage =
    nanobind::ndarray<const std::uint8_t, nanobind::shape<-1, -1>, nanobind::device::cpu>;

// Shares the pixels: they must live and not change as long as it is used. Nobody writes to them.
// Throws Error when the pixels of a row do not lie side by side.
inline cv::Mat AsMat(const GivenImage& image) {
  if (image.stride(1) != 1 || image.stride(0) < static_cast<std::int64_t>(image.shape(1))) {
    Fail(
        "the pixels of an image's rows must lie side by side: numpy.ascontiguousarray makes it so");
  }
  return cv::Mat(static_cast<int>(image.shape(0)), static_cast<int>(image.shape(1)), CV_8UC1,
                 const_cast<std::uint8_t*>(image.data()),
                 static_cast<std::size_t>(image.stride(0)));
}

}  // namespace airslam::python
