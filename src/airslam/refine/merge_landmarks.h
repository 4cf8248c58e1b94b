// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "airslam/refine/map_processor.h"

namespace airslam {

// Makes one of landmarks that are the same (paper, section VI-A): the points that a loop's inliers
// join, and lines that share more than three points. The older landmark (the smaller id) stays; all
// keyframes name it from then on. Where only one of two matched keypoints has a landmark, the other
// keyframe sees it too. A keyframe that would see one landmark twice keeps the keypoint that saw it
// first; lines that one keyframe sees apart stay apart.
class MergeLandmarks : public MapProcessor {
 public:
  void Process(Map& map, RefineContext& context) override;
};

}  // namespace airslam
