// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/map/covisibility.h"

#include <algorithm>

namespace airslam {

CovisibilityGraph CountCovisibility(const Map& map) {
  CovisibilityGraph graph;
  std::map<LandmarkId, std::vector<KeyframeId>> seen_by;  // ascending keyframe ids
  for (const auto& [id, keyframe] : map.keyframes) {
    graph[id] = {};
    for (const LandmarkId landmark : keyframe.landmarks) {
      if (landmark == kNoLandmark) continue;
      std::vector<KeyframeId>& keyframes = seen_by[landmark];
      if (keyframes.empty() || keyframes.back() != id) keyframes.push_back(id);
    }
  }
  for (const auto& [landmark, keyframes] : seen_by) {
    for (const KeyframeId a : keyframes) {
      for (const KeyframeId b : keyframes) {
        if (a != b) ++graph[a][b];
      }
    }
  }
  return graph;
}

std::vector<std::pair<KeyframeId, int>> NeighboursByCount(const CovisibilityGraph& graph,
                                                          KeyframeId keyframe) {
  const auto entry = graph.find(keyframe);
  if (entry == graph.end()) return {};
  std::vector<std::pair<KeyframeId, int>> neighbours(entry->second.begin(), entry->second.end());
  std::stable_sort(neighbours.begin(), neighbours.end(),
                   [](const auto& a, const auto& b) { return a.second > b.second; });
  return neighbours;
}

}  // namespace airslam
