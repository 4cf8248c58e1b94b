// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/feature/stereo_matching.h"

#include <algorithm>
#include <cmath>

namespace airslam {
namespace {

// The column where a left keypoint is found along its row of the right image, and from where in the
// left image nothing else is found that looks more alike; < 0: none. At half resolution: noise is
// weaker there, rows need not agree by the pixel, and the alignment that follows reaches farther
// than its error.
double SearchRight(const StereoView& view, const Keypoint& left, double max_disparity,
                   const RowSearchOptions& options) {
  constexpr int kLevel = 1;
  constexpr double kScale = 1 << kLevel;
  const cv::Mat& left_image = view.left_image.levels[kLevel];
  const cv::Mat& right_image = view.right_image.levels[kLevel];
  const int column = static_cast<int>(std::lround(left.x / kScale));
  const int row = static_cast<int>(std::lround(left.y / kScale));
  const int reach = static_cast<int>(std::ceil(max_disparity / kScale));
  const auto right =
      SearchRow(left_image, right_image, column, row, column - reach, column + 2, options);
  if (!right) return -1;
  const int found = static_cast<int>(std::lround(*right));
  const auto back = SearchRow(right_image, left_image, found, row, found - 2, found + reach,
                              {options.min_correlation, 1.0});
  if (!back || std::abs(*back - column) > 1.5) return -1;
  return kScale * *right + left.x - kScale * column;
}

// Columns of the left keypoints in the right image, aligned by patch at one level of the pyramids
// from the guessed columns (< 0: none).
void AlignRight(const StereoView& view, std::span<const double> guesses, double max_disparity,
                int level, const StereoMatchingOptions& options, std::vector<float>& right_x) {
  const double scale = 1 << level;
  const PatchAlignmentOptions& alignment =
      level == 0 ? options.alignment : options.coarse_alignment;
  for (std::size_t i = 0; i < guesses.size(); ++i) {
    if (guesses[i] < 0 || right_x[i] >= 0) continue;
    const Eigen::Vector2d left(view.left_keypoints[i].x, view.left_keypoints[i].y);
    const PatchAlignment aligned = AlignPatch(
        view.left_image.levels[level], left / scale, Eigen::Matrix2d::Identity(),
        view.right_image.levels[level], Eigen::Vector2d(guesses[i], left.y()) / scale, alignment);
    const Eigen::Vector2d right = scale * aligned.pixel;
    const double disparity = left.x() - right.x();
    if (aligned.converged && disparity >= options.min_disparity && disparity <= max_disparity &&
        std::abs(right.y() - left.y()) <= scale * options.max_row_difference) {
      right_x[i] = static_cast<float>(right.x());
    }
  }
}

}  // namespace

std::vector<float> MatchStereo(const StereoView& view, const StereoCamera& stereo,
                               std::span<const float> expected_disparities,
                               const StereoMatchingOptions& options) {
  const double max_disparity = stereo.Disparity(options.min_depth);
  std::vector<double> guesses(view.left_keypoints.size(), -1.0);
  for (std::size_t i = 0; i < guesses.size(); ++i) {
    const Keypoint& left = view.left_keypoints[i];
    if (!expected_disparities.empty() && expected_disparities[i] >= 0) {
      guesses[i] = left.x - expected_disparities[i];
    } else {
      guesses[i] = SearchRight(view, left, max_disparity, options.search);
    }
  }
  std::vector<float> right_x(guesses.size(), -1.0f);
  AlignRight(view, guesses, max_disparity, 0, options, right_x);
  const auto found = std::count_if(right_x.begin(), right_x.end(), [](float x) { return x >= 0; });
  if (found < options.coarse_below) {
    AlignRight(view, guesses, max_disparity, 1, options, right_x);
  }
  return right_x;
}

}  // namespace airslam
