// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "airslam/refine/map_processor.h"

namespace airslam {

// Bundle adjustment of the whole map (paper, section VI-A; optimize/bundle): all keyframes and all
// landmarks that two of them see, with the loops' relative poses; a rough phase without, then a
// fine phase with rejection of outliers. The first keyframe of each component stays. Landmarks that
// one keyframe sees go along with it. Where the map has inertial states and readings they take
// part, with gravity as found from them.
class GlobalBundle : public MapProcessor {
 public:
  void Process(Map& map, RefineContext& context) override;
};

}  // namespace airslam
