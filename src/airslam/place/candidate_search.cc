// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/place/candidate_search.h"

#include <algorithm>
#include <set>

#include "airslam/common/options.h"

namespace airslam {
namespace {

bool Better(const ScoredKeyframe& a, const ScoredKeyframe& b) {
  return a.score != b.score ? a.score > b.score : a.id < b.id;
}

int Shared(const CovisibilityGraph& graph, KeyframeId a, KeyframeId b) {
  const auto from = graph.find(a);
  if (from == graph.end()) return 0;
  const auto to = from->second.find(b);
  return to == from->second.end() ? 0 : to->second;
}

// A keyframe with those that see the same: its score is the group's, `id` the group's best.
ScoredKeyframe MakeGroup(const ScoredKeyframe& center, std::span<const ScoredKeyframe> candidates,
                         const CovisibilityGraph& graph, int min_shared) {
  double sum = 0;
  ScoredKeyframe best = center;
  for (const ScoredKeyframe& other : candidates) {
    if (other.id != center.id && Shared(graph, center.id, other.id) <= min_shared) continue;
    sum += other.score;
    if (Better(other, best)) best = other;
  }
  return {best.id, sum};
}

}  // namespace

void CandidateOptions::Validate() const {
  RequireOption(min_score_share >= 0 && min_score_share < 1, "min_score_share", min_score_share,
                "must be at least 0 and below 1");
  RequireOption(min_shared_in_group >= 0, "min_shared_in_group", min_shared_in_group,
                "must not be negative");
  RequireOption(max_groups >= 1, "max_groups", max_groups, "must be at least 1");
}

std::vector<ScoredKeyframe> KeepHighScores(std::span<const ScoredKeyframe> scores,
                                           double min_score_share) {
  double best = 0;
  for (const ScoredKeyframe& keyframe : scores) best = std::max(best, keyframe.score);
  std::vector<ScoredKeyframe> kept;
  for (const ScoredKeyframe& keyframe : scores) {
    if (keyframe.score > min_score_share * best) kept.push_back(keyframe);
  }
  std::sort(kept.begin(), kept.end(), Better);
  return kept;
}

std::vector<ScoredKeyframe> FindLoopCandidates(std::span<const ScoredKeyframe> scores,
                                               KeyframeId id, const CovisibilityGraph& covisibility,
                                               const CandidateOptions& options) {
  std::vector<ScoredKeyframe> earlier;
  for (const ScoredKeyframe& keyframe : scores) {
    if (keyframe.id < id && Shared(covisibility, id, keyframe.id) == 0) earlier.push_back(keyframe);
  }
  const std::vector<ScoredKeyframe> kept = KeepHighScores(earlier, options.min_score_share);
  std::vector<ScoredKeyframe> groups;
  for (const ScoredKeyframe& keyframe : kept) {
    groups.push_back(MakeGroup(keyframe, kept, covisibility, options.min_shared_in_group));
  }
  std::sort(groups.begin(), groups.end(), Better);
  std::vector<ScoredKeyframe> candidates;
  std::set<KeyframeId> taken;
  for (const ScoredKeyframe& group : groups) {
    if (static_cast<int>(candidates.size()) == options.max_groups) break;
    if (taken.insert(group.id).second) candidates.push_back(group);
  }
  return candidates;
}

}  // namespace airslam
