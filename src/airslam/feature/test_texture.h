// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

namespace airslam {

// A random texture: noise, blurred by so many pixels, from grey level `low` to `high`.
inline cv::Mat RandomTexture(cv::Size size, std::uint64_t seed, double blur, double low,
                             double high) {
  cv::Mat noise(size, CV_8UC1), texture;
  cv::RNG(seed).fill(noise, cv::RNG::UNIFORM, 0, 255);
  cv::GaussianBlur(noise, texture, {}, blur);
  cv::normalize(texture, texture, low, high, cv::NORM_MINMAX);
  return texture;
}

// What `image` shows, `disparity` pixels further left.
inline cv::Mat ShiftedLeft(const cv::Mat& image, double disparity) {
  cv::Mat shifted;
  const cv::Matx23d shift(1, 0, -disparity, 0, 1, 0);
  cv::warpAffine(image, shifted, shift, image.size(), cv::INTER_CUBIC);
  return shifted;
}

}  // namespace airslam
