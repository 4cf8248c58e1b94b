// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/place/structure_graph.h"

#include <algorithm>
#include <cstddef>
#include <iterator>

#include "airslam/feature/line_refinement.h"

namespace airslam {
namespace {

// Pixels, of a line's end from its junction: a keyframe's lines have moved onto their edges since.
constexpr auto kMaxEndDistance = static_cast<float>(LineRefinementOptions{}.reach);

int NearestJunction(float x, float y, std::span<const Keypoint> junctions) {
  int nearest = -1;
  float best = kMaxEndDistance * kMaxEndDistance;
  for (std::size_t i = 0; i < junctions.size(); ++i) {
    const float dx = junctions[i].x - x, dy = junctions[i].y - y;
    const float squared = dx * dx + dy * dy;
    if (squared > best || (squared == best && nearest >= 0)) continue;
    best = squared;
    nearest = static_cast<int>(i);
  }
  return nearest;
}

struct JunctionPair {
  int query, keyframe;
  float cosine;
};

// All pairs that have one word, most similar first.
std::vector<JunctionPair> PairsOfOneWord(const Junctions& query, const Junctions& keyframe) {
  std::vector<std::pair<WordId, int>> held;  // words of the keyframe's junctions, ordered
  for (std::size_t i = 0; i < keyframe.words.size(); ++i) {
    held.emplace_back(keyframe.words[i], static_cast<int>(i));
  }
  std::sort(held.begin(), held.end());
  std::vector<JunctionPair> pairs;
  for (std::size_t q = 0; q < query.words.size(); ++q) {
    const WordId word = query.words[q];
    auto entry = std::lower_bound(held.begin(), held.end(), std::pair(word, 0));
    for (; entry != held.end() && entry->first == word; ++entry) {
      const float cosine = query.descriptors.row(static_cast<Eigen::Index>(q))
                               .dot(keyframe.descriptors.row(entry->second));
      pairs.push_back({static_cast<int>(q), entry->second, cosine});
    }
  }
  std::stable_sort(pairs.begin(), pairs.end(), [](const JunctionPair& a, const JunctionPair& b) {
    return a.cosine > b.cosine;
  });
  return pairs;
}

// The lines between matched junctions, named by the number of the match, in order.
std::vector<std::pair<int, int>> MatchedLines(const std::vector<std::pair<int, int>>& lines,
                                              const std::vector<int>& match_of) {
  std::vector<std::pair<int, int>> matched;
  for (const auto& [a, b] : lines) {
    const int m = match_of[static_cast<std::size_t>(a)], n = match_of[static_cast<std::size_t>(b)];
    if (m >= 0 && n >= 0) matched.emplace_back(std::minmax(m, n));
  }
  std::sort(matched.begin(), matched.end());
  return matched;
}

}  // namespace

std::vector<std::pair<int, int>> JoinLines(std::span<const LineSegment> lines,
                                           std::span<const Keypoint> junctions) {
  std::vector<std::pair<int, int>> joined;
  for (const LineSegment& line : lines) {
    const int start = NearestJunction(line.x1, line.y1, junctions);
    const int end = NearestJunction(line.x2, line.y2, junctions);
    if (start >= 0 && end >= 0 && start != end) joined.emplace_back(std::minmax(start, end));
  }
  std::sort(joined.begin(), joined.end());
  joined.erase(std::unique(joined.begin(), joined.end()), joined.end());
  return joined;
}

std::vector<std::pair<int, int>> MatchJunctions(const Junctions& query, const Junctions& keyframe) {
  std::vector<bool> query_taken(query.words.size()), keyframe_taken(keyframe.words.size());
  std::vector<std::pair<int, int>> matches;
  for (const JunctionPair& pair : PairsOfOneWord(query, keyframe)) {
    const auto q = static_cast<std::size_t>(pair.query);
    const auto k = static_cast<std::size_t>(pair.keyframe);
    if (query_taken[q] || keyframe_taken[k]) continue;
    query_taken[q] = keyframe_taken[k] = true;
    matches.emplace_back(pair.query, pair.keyframe);
  }
  std::sort(matches.begin(), matches.end());
  return matches;
}

double StructureScore(const Junctions& query, const Junctions& keyframe) {
  const std::vector<std::pair<int, int>> matches = MatchJunctions(query, keyframe);
  if (matches.empty()) return 0;
  std::vector<int> query_match(query.words.size(), -1), keyframe_match(keyframe.words.size(), -1);
  for (std::size_t m = 0; m < matches.size(); ++m) {
    query_match[static_cast<std::size_t>(matches[m].first)] = static_cast<int>(m);
    keyframe_match[static_cast<std::size_t>(matches[m].second)] = static_cast<int>(m);
  }
  const auto in_query = MatchedLines(query.lines, query_match);
  const auto in_keyframe = MatchedLines(keyframe.lines, keyframe_match);
  std::vector<std::pair<int, int>> different;
  std::set_symmetric_difference(in_query.begin(), in_query.end(), in_keyframe.begin(),
                                in_keyframe.end(), std::back_inserter(different));
  // Every entry of the two matrices agrees but these, each of which stands twice.
  const auto n = static_cast<double>(matches.size());
  return (n * n - 2 * static_cast<double>(different.size())) / n;
}

}  // namespace airslam
