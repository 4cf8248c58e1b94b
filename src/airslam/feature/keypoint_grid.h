// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include <span>
#include <vector>

#include "airslam/neural/detections.h"

namespace airslam {

// Finds the keypoints near a pixel without looking at all of them. Keeps a copy of positions only.
class KeypointGrid {
 public:
  KeypointGrid(std::span<const Keypoint> keypoints, int width, int height);

  // Whether a keypoint lies within `radius` pixels of `pixel`.
  bool AnyNear(const Eigen::Vector2d& pixel, double radius) const {
    bool any = false;
    VisitNear(pixel, radius, [&](int) { any = true; });
    return any;
  }

  // Calls visit(index) for every keypoint within `radius` pixels of `pixel`, cell by cell: the
  // order depends on the keypoints only.
  template <typename Visitor>
  void VisitNear(const Eigen::Vector2d& pixel, double radius, Visitor&& visit) const {
    const int x0 = Column(pixel.x() - radius), x1 = Column(pixel.x() + radius);
    const int y0 = Row(pixel.y() - radius), y1 = Row(pixel.y() + radius);
    for (int y = y0; y <= y1; ++y) {
      for (int x = x0; x <= x1; ++x) {
        const int cell = y * columns_ + x;
        for (int k = starts_[cell]; k < starts_[cell + 1]; ++k) {
          const Eigen::Vector2f offset = positions_[indices_[k]] - pixel.cast<float>();
          if (offset.squaredNorm() <= radius * radius) visit(indices_[k]);
        }
      }
    }
  }

 private:
  static constexpr int kCell = 16;  // pixels
  int Column(double x) const;
  int Row(double y) const;

  int columns_ = 0;
  int rows_ = 0;
  std::vector<Eigen::Vector2f> positions_;
  std::vector<int> starts_;   // of each cell in indices_, one more than cells
  std::vector<int> indices_;  // keypoints ordered by cell, then by index
};

}  // namespace airslam
