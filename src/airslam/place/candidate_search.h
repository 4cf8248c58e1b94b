// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>
#include <vector>

#include "airslam/map/covisibility.h"
#include "airslam/place/inverted_index.h"

namespace airslam {

struct CandidateOptions {
  double min_score_share = 0.3;  // of the best score, 0..1: below it no candidate
  // Loops only: keyframes that share more features than this form a group, and of the best groups
  // one keyframe each is taken.
  int min_shared_in_group = 10;
  int max_groups = 3;

  // Throws Error that names the wrong field.
  void Validate() const;
};

// Every keyframe with a score above the share of the best one, best first, ties by id (design,
// section 1, relocalization stage 1: no reduction to one a group).
std::vector<ScoredKeyframe> KeepHighScores(std::span<const ScoredKeyframe> scores,
                                           double min_score_share);

// Loop candidates of keyframe `id` (design, section 1; paper, section VI-A): of `scores` (of the
// keyframe's own bag against the index) only keyframes before `id` that share no landmark with it;
// those with a score above the share of the best; each of them with those of the rest that share
// more than `min_shared_in_group` landmarks with it makes a group, whose score is the sum of its
// members'; of the groups with the best scores the best keyframe each, at most `max_groups`, no
// keyframe twice. Best group first, ties by id.
std::vector<ScoredKeyframe> FindLoopCandidates(std::span<const ScoredKeyframe> scores,
                                               KeyframeId id, const CovisibilityGraph& covisibility,
                                               const CandidateOptions& options);

}  // namespace airslam
