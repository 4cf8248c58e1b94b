// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/feature/row_search.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <opencv2/core/hal/intrin.hpp>
#include <vector>

namespace airslam {
namespace {

constexpr int kHalf = 5;
constexpr int kSide = 2 * kHalf + 1;
constexpr double kArea = kSide * kSide;
constexpr int kLoaded = 16;  // columns that are read at once, the patch being the first kSide
constexpr double kMinDeviation = 1.5;  // grey levels: below it a patch is noise

using Row = std::array<std::uint8_t, kLoaded>;

// The patch row by row, with zeros behind each, so that products with more columns are with it.
struct Patch {
  alignas(kLoaded) std::array<Row, kSide> rows{};
  double mean = 0;
  double deviation = 0;
};

Patch Take(const cv::Mat& image, int column, int row) {
  Patch patch;
  double sum = 0, squares = 0;
  for (int y = 0; y < kSide; ++y) {
    const std::uint8_t* source = image.ptr<std::uint8_t>(row - kHalf + y) + column - kHalf;
    std::copy_n(source, kSide, patch.rows[y].begin());
    for (int x = 0; x < kSide; ++x) {
      sum += source[x];
      squares += source[x] * source[x];
    }
  }
  patch.mean = sum / kArea;
  patch.deviation = std::sqrt(std::max(squares / kArea - patch.mean * patch.mean, 0.0));
  return patch;
}

// Zero-mean normalised correlation of the patch with that whose upper left corner is `corner`;
// whole numbers until the last step, so that it is the same on every machine.
double Correlate(const Patch& patch, const std::uint8_t* corner, std::size_t step) {
  static constexpr Row kInside = {255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255};
  const cv::v_uint8x16 inside = cv::v_load(kInside.data()), one = cv::v_setall_u8(1);
  cv::v_uint32x4 products = cv::v_setzero_u32(), sums = products, squares = products;
  for (int y = 0; y < kSide; ++y, corner += step) {
    const cv::v_uint8x16 seen = cv::v_load(corner) & inside;
    products = cv::v_dotprod_expand(seen, cv::v_load(patch.rows[y].data()), products);
    sums = cv::v_dotprod_expand(seen, one, sums);
    squares = cv::v_dotprod_expand(seen, seen, squares);
  }
  const double mean = cv::v_reduce_sum(sums) / kArea;
  const double variance = cv::v_reduce_sum(squares) / kArea - mean * mean;
  if (variance < kMinDeviation * kMinDeviation) return -1;
  const double covariance = cv::v_reduce_sum(products) / kArea - mean * patch.mean;
  return covariance / (patch.deviation * std::sqrt(variance));
}

// Whether another maximum than the best is nearly as good.
bool IsAmbiguous(const std::vector<double>& correlations, std::size_t best, double max_ambiguity) {
  for (std::size_t i = 1; i + 1 < correlations.size(); ++i) {
    const bool peak =
        correlations[i] >= correlations[i - 1] && correlations[i] >= correlations[i + 1];
    if (peak && (i + 2 < best || i > best + 2) &&
        1 - correlations[best] > max_ambiguity * (1 - correlations[i])) {
      return true;
    }
  }
  return false;
}

}  // namespace

std::optional<double> SearchRow(const cv::Mat& reference, const cv::Mat& image, int column, int row,
                                int first, int last, const RowSearchOptions& options) {
  first = std::max(first, kHalf);
  // The last columns that are read may lie behind the patch, yet not behind the image.
  last = std::min(last, image.cols - kLoaded + kHalf);
  if (row < kHalf || row >= image.rows - kHalf || column < kHalf ||
      column >= reference.cols - kHalf || last - first < 2) {
    return std::nullopt;
  }
  const Patch patch = Take(reference, column, row);
  if (patch.deviation < kMinDeviation) return std::nullopt;
  std::vector<double> correlations(last - first + 1);
  const std::uint8_t* corner = image.ptr<std::uint8_t>(row - kHalf) + first - kHalf;
  for (std::size_t i = 0; i < correlations.size(); ++i) {
    correlations[i] = Correlate(patch, corner + i, image.step[0]);
  }
  const std::size_t best =
      std::max_element(correlations.begin(), correlations.end()) - correlations.begin();
  // A best place at the border may be the slope of a better one beyond.
  if (correlations[best] < options.min_correlation || best == 0 ||
      best + 1 == correlations.size() || IsAmbiguous(correlations, best, options.max_ambiguity)) {
    return std::nullopt;
  }
  const double before = correlations[best - 1], after = correlations[best + 1];
  const double bend = before - 2 * correlations[best] + after;
  const double shift = bend < 0 ? 0.5 * (before - after) / bend : 0.0;
  return first + static_cast<double>(best) + shift;
}

}  // namespace airslam
