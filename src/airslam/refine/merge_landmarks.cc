// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/refine/merge_landmarks.h"

#include <set>

#include "airslam/feature/point_line_association.h"
#include "airslam/refine/map_tools.h"

namespace airslam {
namespace {

// Sets of landmarks that are one; each is known by its smallest id.
class Unions {
 public:
  LandmarkId Find(LandmarkId id) {
    const auto parent = parents_.find(id);
    if (parent == parents_.end()) return id;
    return parent->second = Find(parent->second);
  }
  // False when they were one already.
  bool Join(LandmarkId a, LandmarkId b) {
    a = Find(a);
    b = Find(b);
    if (a == b) return false;
    parents_[std::max(a, b)] = std::min(a, b);
    return true;
  }

 private:
  std::map<LandmarkId, LandmarkId> parents_;
};

// Replaces ids by those of their sets; the second of two equal ones in a keyframe is dropped.
void Rename(Unions& unions, std::vector<LandmarkId>& ids) {
  std::set<LandmarkId> named;
  for (LandmarkId& id : ids) {
    if (id == kNoLandmark) continue;
    id = unions.Find(id);
    if (!named.insert(id).second) id = kNoLandmark;
  }
}

bool Sees(const Keyframe& keyframe, LandmarkId id) {
  return std::find(keyframe.landmarks.begin(), keyframe.landmarks.end(), id) !=
         keyframe.landmarks.end();
}

// The two keypoints show the same point: of a loop.
void JoinPoints(const Loop& loop, Unions& unions, Map& map, int& added) {
  Keyframe& earlier = map.keyframes.at(loop.earlier);
  Keyframe& later = map.keyframes.at(loop.later);
  for (const auto& [i, j] : loop.keypoints) {
    LandmarkId& a = earlier.landmarks[i];
    LandmarkId& b = later.landmarks[j];
    if (a != kNoLandmark && b != kNoLandmark) {
      unions.Join(a, b);
    } else if (a != kNoLandmark && !Sees(later, a)) {
      b = a;
      ++added;
    } else if (b != kNoLandmark && !Sees(earlier, b)) {
      a = b;
      ++added;
    }
  }
}

int MergePoints(RefineContext& context, Map& map, int& added) {
  Unions unions;
  int done = 0;
  for (Loop& loop : context.loops) {
    context.progress(++done, static_cast<int>(context.loops.size()), "points");
    if (!map.keyframes.contains(loop.earlier) || !map.keyframes.contains(loop.later)) continue;
    JoinPoints(loop, unions, map, added);
    loop.merged = true;
  }
  for (auto& [id, keyframe] : map.keyframes) Rename(unions, keyframe.landmarks);
  return static_cast<int>(std::erase_if(
      map.landmarks, [&](const auto& entry) { return unions.Find(entry.first) != entry.first; }));
}

// The point landmarks on each line landmark, as all keyframes saw them.
std::map<LandmarkId, std::set<LandmarkId>> PointsOfLines(const Map& map) {
  std::map<LandmarkId, std::set<LandmarkId>> points;
  for (const auto& [id, keyframe] : map.keyframes) {
    const PointLineAssociation associated = AssociatePoints(keyframe.keypoints, keyframe.lines);
    for (std::size_t line = 0; line < keyframe.lines.size(); ++line) {
      if (keyframe.line_landmarks[line] == kNoLandmark) continue;
      for (const int point : associated.points_of_line[line]) {
        if (keyframe.landmarks[point] == kNoLandmark) continue;
        points[keyframe.line_landmarks[line]].insert(keyframe.landmarks[point]);
      }
    }
  }
  return points;
}

// How many points two lines share, for each pair that shares one.
std::map<std::pair<LandmarkId, LandmarkId>, int> SharedPoints(const Map& map) {
  std::map<LandmarkId, std::vector<LandmarkId>> lines_of_point;  // ascending
  for (const auto& [line, points] : PointsOfLines(map)) {
    for (const LandmarkId point : points) lines_of_point[point].push_back(line);
  }
  std::map<std::pair<LandmarkId, LandmarkId>, int> shared;
  for (const auto& [point, lines] : lines_of_point) {
    for (std::size_t a = 0; a < lines.size(); ++a) {
      for (std::size_t b = a + 1; b < lines.size(); ++b) ++shared[{lines[a], lines[b]}];
    }
  }
  return shared;
}

// Pairs of lines that a keyframe sees side by side, as two.
std::set<std::pair<LandmarkId, LandmarkId>> LinesSeenApart(const Map& map) {
  std::set<std::pair<LandmarkId, LandmarkId>> apart;
  for (const auto& [id, keyframe] : map.keyframes) {
    for (const LandmarkId a : keyframe.line_landmarks) {
      for (const LandmarkId b : keyframe.line_landmarks) {
        if (a != kNoLandmark && b != kNoLandmark && a < b) apart.emplace(a, b);
      }
    }
  }
  return apart;
}

int MergeLines(const MergeOptions& options, Map& map) {
  if (map.line_landmarks.empty()) return 0;
  Unions unions;
  const auto apart = LinesSeenApart(map);
  for (const auto& [pair, count] : SharedPoints(map)) {
    if (count > options.min_shared_points && !apart.contains(pair)) {
      unions.Join(pair.first, pair.second);
    }
  }
  for (auto& [id, keyframe] : map.keyframes) Rename(unions, keyframe.line_landmarks);
  return static_cast<int>(std::erase_if(map.line_landmarks, [&](const auto& entry) {
    return unions.Find(entry.first) != entry.first;
  }));
}

}  // namespace

void MergeLandmarks::Process(Map& map, RefineContext& context) {
  int added = 0;
  context.report["points_merged"] = MergePoints(context, map, added);
  context.report["observations_added"] = added;
  context.report["lines_merged"] = MergeLines(context.options.merge, map);
  RemoveUnseenLandmarks(map);
}

}  // namespace airslam
