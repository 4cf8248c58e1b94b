// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "airslam/map/covisibility.h"
#include "airslam/map/keyframe.h"
#include "airslam/map/map_codec.h"

namespace airslam {

// What place recognition keeps in an optimized map, so that it need not be computed whenever the
// map is opened (place/place_index.h makes and uses it; tables in docs/map_format.md).
struct PlaceRecord {
  // The word of every keypoint and junction of a keyframe, in their order.
  struct Words {
    std::vector<std::uint16_t> keypoints;
    std::vector<std::uint16_t> junctions;  // empty without a junction vocabulary
    bool operator==(const Words&) const = default;
  };
  std::string vocabulary_sha256;  // of the keypoint vocabulary's file, which is not in the map
  std::map<KeyframeId, Words> words;
  Bytes junction_vocabulary;  // the content of a vocabulary file; empty: none
  CovisibilityGraph covisibility;
};

}  // namespace airslam
