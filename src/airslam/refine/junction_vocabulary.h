// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "airslam/refine/map_processor.h"

namespace airslam {

// Prepares the map for relocalization (paper, section VI-A; place/place_index): trains the junction
// vocabulary on the map's own junctions, looks up the words of every keyframe and counts the
// co-visibility of the whole map. The result is stored with the map. Without a keypoint vocabulary
// it does nothing; with too few junctions it leaves the junction vocabulary out.
class JunctionVocabulary : public MapProcessor {
 public:
  void Process(Map& map, RefineContext& context) override;
};

}  // namespace airslam
