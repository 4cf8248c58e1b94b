// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <utility>
#include <vector>

#include "airslam/map/map.h"

namespace airslam {

// How many landmarks each two keyframes share: graph[a][b] == graph[b][a] > 0. Every keyframe of
// the map has an entry, an empty one when it shares nothing.
using CovisibilityGraph = std::map<KeyframeId, std::map<KeyframeId, int>>;

// A landmark that a keyframe names several times counts once.
CovisibilityGraph CountCovisibility(const Map& map);

// The neighbours of a keyframe and their counts, most shared landmarks first, ties by id.
std::vector<std::pair<KeyframeId, int>> NeighboursByCount(const CovisibilityGraph& graph,
                                                          KeyframeId keyframe);

}  // namespace airslam
