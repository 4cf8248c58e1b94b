// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/line_search.h"

#include <utility>

#include "airslam/feature/stereo_lines.h"

namespace airslam {

void LineSearch::Begin(LineSearchImages images) {
  under_way_ =
      std::async(std::launch::async, [this, images = std::move(images)] { return Find(images); });
}

std::optional<KeyframeLines> LineSearch::Take() {
  if (!under_way_.valid()) return std::nullopt;
  ScopedStage stage(times_, "wait for lines");
  return under_way_.get();
}

KeyframeLines LineSearch::Find(const LineSearchImages& images) {
  KeyframeLines found;
  found.keyframe = images.keyframe;
  {
    ScopedStage stage(times_, "detect lines");
    found.left = detector_.FindLines(images.left.full(), rectifier_.left_mask(), images.seen,
                                     {0, true, static_cast<float>(options_.min_score)});
  }
  ScopedStage stage(times_, "find lines in right image");
  found.right = FindRightLines(found.left.lines, images.left, images.right, rectifier_.stereo());
  return found;
}

}  // namespace airslam
