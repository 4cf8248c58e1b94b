// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>
#include <vector>

#include "airslam/feature/point_line_association.h"
#include "airslam/neural/detections.h"

namespace airslam {

struct LineMatchingOptions {
  // The paper leaves both thresholds open. A keyframe is made when fewer than 65 % of the points
  // are tracked, so a good pair of lines shares about half of its points; and two shared points are
  // the fewest that fix a line.
  double min_score = 0.3;     // delta_S: S_mn must be greater
  int min_shared_points = 1;  // delta_N: N_pm must be greater
};

// Matches the lines of two images by the point matches that they share (paper, section V-B): m and
// n match when S_mn = N_pm / min(N_m, N_n) > delta_S and N_pm > delta_N, where N_m and N_n are the
// numbers of all points on m and on n, and N_pm that of the point matches between them.
//
// One to one, where the paper leaves it open: of rivals the pair with more shared points wins (a
// short piece of a line has a high score by chance), then the one with the higher score, then the
// lower index0, then the lower index1. Match::score is S_mn. Ordered by index0.
//
// `point_matches` index the points that the associations were made of, each point at most once; an
// index beyond them is an std::out_of_range.
std::vector<Match> MatchLines(const PointLineAssociation& image0,
                              const PointLineAssociation& image1,
                              std::span<const Match> point_matches,
                              const LineMatchingOptions& options = {});

}  // namespace airslam
