// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/feature/stereo_matching.h"

#include <algorithm>
#include <cmath>

namespace airslam {
namespace {

// Right keypoints by the row they lie in, so that an epipolar band is a few rows.
class RowIndex {
 public:
  RowIndex(std::span<const Keypoint> keypoints, int height) : rows_(height) {
    for (std::size_t i = 0; i < keypoints.size(); ++i) {
      rows_[Clamp(std::lround(keypoints[i].y))].push_back(static_cast<int>(i));
    }
  }

  template <typename Visitor>
  void VisitBand(double y, double half_height, Visitor&& visit) const {
    const int last = Clamp(std::lround(y + half_height));
    for (int row = Clamp(std::lround(y - half_height)); row <= last; ++row) {
      for (int index : rows_[row]) visit(index);
    }
  }

 private:
  int Clamp(long row) const {
    return static_cast<int>(std::clamp<long>(row, 0, static_cast<long>(rows_.size()) - 1));
  }
  std::vector<std::vector<int>> rows_;
};

// For each left keypoint the right keypoint that is mutually most similar along the epipolar row.
std::vector<int> MatchAlongRows(const StereoView& view, double max_disparity,
                                const StereoMatchingOptions& options) {
  const RowIndex rows(view.right.keypoints, view.right_image.full().rows);
  std::vector<int> best_right(view.left_keypoints.size(), -1);
  std::vector<Match> best_left(view.right.keypoints.size());
  for (std::size_t i = 0; i < view.left_keypoints.size(); ++i) {
    const Keypoint& left = view.left_keypoints[i];
    double best = options.min_similarity;
    rows.VisitBand(left.y, options.max_row_difference, [&](int j) {
      const double disparity = left.x - view.right.keypoints[j].x;
      if (disparity < -1 || disparity > max_disparity) return;
      const float similarity =
          view.left_descriptors.row(static_cast<int>(i)).dot(view.right.descriptors.row(j));
      if (similarity > best) {
        best = similarity;
        best_right[i] = j;
      }
      if (best_left[j].index0 < 0 || similarity > best_left[j].score) {
        best_left[j] = {static_cast<int>(i), j, similarity};
      }
    });
  }
  for (std::size_t i = 0; i < best_right.size(); ++i) {
    if (best_right[i] >= 0 && best_left[best_right[i]].index0 != static_cast<int>(i)) {
      best_right[i] = -1;
    }
  }
  return best_right;
}

// Columns of the left keypoints in the right image, aligned by patch at one level of the pyramids
// from the guessed columns (< 0: none).
void AlignRight(const StereoView& view, std::span<const double> guesses, double max_disparity,
                int level, const StereoMatchingOptions& options, std::vector<float>& right_x) {
  const double scale = 1 << level;
  for (std::size_t i = 0; i < guesses.size(); ++i) {
    if (guesses[i] < 0 || right_x[i] >= 0) continue;
    const Eigen::Vector2d left(view.left_keypoints[i].x, view.left_keypoints[i].y);
    const PatchAlignment aligned =
        AlignPatch(view.left_image.levels[level], left / scale, Eigen::Matrix2d::Identity(),
                   view.right_image.levels[level],
                   Eigen::Vector2d(guesses[i], left.y()) / scale, options.alignment);
    const Eigen::Vector2d right = scale * aligned.pixel;
    const double disparity = left.x() - right.x();
    if (aligned.converged && disparity >= options.min_disparity && disparity <= max_disparity &&
        std::abs(right.y() - left.y()) <= scale * options.max_aligned_row_difference) {
      right_x[i] = static_cast<float>(right.x());
    }
  }
}

}  // namespace

std::vector<float> MatchStereo(const StereoView& view, const StereoCamera& stereo,
                               std::span<const float> expected_disparities,
                               const StereoMatchingOptions& options) {
  const double max_disparity = stereo.Disparity(options.min_depth);
  const std::vector<int> matched = MatchAlongRows(view, max_disparity, options);
  std::vector<double> guesses(view.left_keypoints.size(), -1.0);
  for (std::size_t i = 0; i < guesses.size(); ++i) {
    if (!expected_disparities.empty() && expected_disparities[i] >= 0) {
      guesses[i] = view.left_keypoints[i].x - expected_disparities[i];
    } else if (matched[i] >= 0) {
      guesses[i] = view.right.keypoints[matched[i]].x;
    }
  }
  std::vector<float> right_x(guesses.size(), -1.0f);
  AlignRight(view, guesses, max_disparity, 0, options, right_x);
  const auto found =
      std::count_if(right_x.begin(), right_x.end(), [](float x) { return x >= 0; });
  if (found < options.coarse_below) {
    AlignRight(view, guesses, max_disparity, 1, options, right_x);
  }
  return right_x;
}

}  // namespace airslam
