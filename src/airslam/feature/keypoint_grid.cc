// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/feature/keypoint_grid.h"

#include <algorithm>
#include <cmath>

namespace airslam {

KeypointGrid::KeypointGrid(std::span<const Keypoint> keypoints, int width, int height)
    : columns_(width / kCell + 1), rows_(height / kCell + 1) {
  starts_.assign(static_cast<std::size_t>(columns_) * rows_ + 1, 0);
  std::vector<int> cells;
  cells.reserve(keypoints.size());
  for (const Keypoint& keypoint : keypoints) {
    positions_.emplace_back(keypoint.x, keypoint.y);
    cells.push_back(Row(keypoint.y) * columns_ + Column(keypoint.x));
    ++starts_[cells.back() + 1];
  }
  for (std::size_t i = 1; i < starts_.size(); ++i) starts_[i] += starts_[i - 1];
  std::vector<int> next(starts_.begin(), starts_.end() - 1);
  indices_.resize(keypoints.size());
  for (std::size_t i = 0; i < cells.size(); ++i) indices_[next[cells[i]]++] = static_cast<int>(i);
}

int KeypointGrid::Column(double x) const {
  return std::clamp(static_cast<int>(std::floor(x / kCell)), 0, columns_ - 1);
}

int KeypointGrid::Row(double y) const {
  return std::clamp(static_cast<int>(std::floor(y / kCell)), 0, rows_ - 1);
}

}  // namespace airslam
