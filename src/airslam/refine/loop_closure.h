// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "airslam/refine/map_processor.h"

namespace airslam {

// Finds places that were seen before (paper, section VI-A; design, section 1). For each keyframe
// the candidates of place/candidate_search are matched and verified (refine/loop_verification);
// what would move a keyframe by more than odometry can have drifted is not believed. Loops between
// components join them, when enough of them agree: the later component moves into the world of the
// earlier one, and becomes part of it. Needs the matcher and the vocabulary; without them it finds
// nothing.
class LoopClosure : public MapProcessor {
 public:
  void Process(Map& map, RefineContext& context) override;
};

}  // namespace airslam
