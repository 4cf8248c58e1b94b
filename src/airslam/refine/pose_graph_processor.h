// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "airslam/refine/map_processor.h"

namespace airslam {

// Spreads what loops say over the keyframes (paper, section VI-A; optimize/pose_graph): edges
// between consecutive keyframes, as odometry found them, and the loops. The first keyframe of each
// component stays; landmarks move with the keyframe that first saw them. Without loops, or in a map
// below the option's size, it does nothing.
class PoseGraphProcessor : public MapProcessor {
 public:
  void Process(Map& map, RefineContext& context) override;
};

}  // namespace airslam
