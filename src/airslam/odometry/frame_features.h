// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <opencv2/core.hpp>
#include <optional>
#include <utility>

#include "airslam/feature/keypoint_grid.h"
#include "airslam/neural/detections.h"

namespace airslam {

// The features of a frame's left image, detected when they are first asked for: most frames are
// tracked by the patches of landmarks alone, and need none.
class FrameFeatures {
 public:
  FrameFeatures(cv::Size image_size, std::function<Detections()> detect)
      : image_size_(image_size), detect_(std::move(detect)) {}

  const Detections& detections() const {
    if (!detections_) {
      detections_ = detect_();
      grid_.emplace(detections_->keypoints, image_size_.width, image_size_.height);
    }
    return *detections_;
  }
  const KeypointGrid& grid() const {
    detections();
    return *grid_;
  }

  // The detections if there are any yet, else null.
  const Detections* known() const { return detections_ ? &*detections_ : nullptr; }

 private:
  cv::Size image_size_;
  std::function<Detections()> detect_;
  mutable std::optional<Detections> detections_;
  mutable std::optional<KeypointGrid> grid_;
};

}  // namespace airslam
