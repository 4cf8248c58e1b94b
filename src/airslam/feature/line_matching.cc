// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/feature/line_matching.h"

#include <algorithm>
#include <tuple>

namespace airslam {
namespace {

struct Candidate {
  int shared = 0;
  Match match;
};

// Best first.
bool Before(const Candidate& a, const Candidate& b) {
  return std::tuple(-a.shared, -a.match.score, a.match.index0, a.match.index1) <
         std::tuple(-b.shared, -b.match.score, b.match.index0, b.match.index1);
}

}  // namespace

std::vector<Match> MatchLines(const PointLineAssociation& image0,
                              const PointLineAssociation& image1,
                              std::span<const Match> point_matches,
                              const LineMatchingOptions& options) {
  const std::size_t rows = image0.points_of_line.size();
  const std::size_t columns = image1.points_of_line.size();
  std::vector<int> shared(rows * columns, 0);
  for (const Match& match : point_matches) {
    for (const int m : image0.lines_of_point.at(match.index0)) {
      for (const int n : image1.lines_of_point.at(match.index1)) ++shared[m * columns + n];
    }
  }
  std::vector<Candidate> candidates;
  for (std::size_t m = 0; m < rows; ++m) {
    for (std::size_t n = 0; n < columns; ++n) {
      const int count = shared[m * columns + n];
      if (count <= options.min_shared_points || count == 0) continue;
      const std::size_t points =
          std::min(image0.points_of_line[m].size(), image1.points_of_line[n].size());
      const double score = static_cast<double>(count) / static_cast<double>(points);
      if (!(score > options.min_score)) continue;
      candidates.push_back(
          {count, {static_cast<int>(m), static_cast<int>(n), static_cast<float>(score)}});
    }
  }
  std::sort(candidates.begin(), candidates.end(), Before);
  std::vector<bool> taken0(rows, false), taken1(columns, false);
  std::vector<Match> matches;
  for (const Candidate& candidate : candidates) {
    const Match& match = candidate.match;
    if (taken0[match.index0] || taken1[match.index1]) continue;
    taken0[match.index0] = taken1[match.index1] = true;
    matches.push_back(match);
  }
  std::sort(matches.begin(), matches.end(),
            [](const Match& a, const Match& b) { return a.index0 < b.index0; });
  return matches;
}

}  // namespace airslam
