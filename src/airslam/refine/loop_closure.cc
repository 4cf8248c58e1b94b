// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/refine/loop_closure.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "airslam/common/log.h"
#include "airslam/place/candidate_search.h"
#include "airslam/place/place_index.h"
#include "airslam/refine/loop_verification.h"
#include "airslam/refine/map_tools.h"

namespace airslam {
namespace {

// Odometry may always have drifted so far, whatever the path, metres.
constexpr double kDriftFloor = 0.5;

// Metres along the keyframes' path from the first of the map on, by keyframe. Where odometry was
// interrupted the path does not grow.
std::map<KeyframeId, double> PathLengths(const Map& map, const RefineContext& context) {
  std::map<KeyframeId, double> lengths;
  std::map<KeyframeId, double> steps;
  for (const OdometryEdge& edge : context.odometry) {
    steps[edge.to] = edge.from_from_to.translation.norm();
  }
  double length = 0;
  for (const auto& [id, keyframe] : map.keyframes) {
    if (const auto step = steps.find(id); step != steps.end()) length += step->second;
    lengths[id] = length;
  }
  return lengths;
}

// new_world_from_old_world by which the loop would move the later keyframe.
Rigid3 Correction(const Map& map, const Loop& loop) {
  return map.keyframes.at(loop.earlier).world_from_cam * loop.earlier_from_later *
         map.keyframes.at(loop.later).world_from_cam.Inverse();
}

// Whether odometry can have drifted so much within one component.
bool IsPlausible(const Map& map, const Loop& loop, double path, const LoopClosureOptions& options) {
  const Rigid3& later = map.keyframes.at(loop.later).world_from_cam;
  const Rigid3 corrected = Correction(map, loop) * later;
  const Rigid3 move = later.Inverse() * corrected;
  return move.translation.norm() <= kDriftFloor + options.max_drift * path &&
         move.Angle() <= options.max_drift_angle;
}

// Loops between two components, which agree about how one lies in the other.
std::vector<Loop> LargestAgreement(const Map& map, const std::vector<Loop>& loops,
                                   const LoopClosureOptions& options) {
  constexpr double kDistance = 0.5;  // metres: what both odometries may have drifted meanwhile
  std::vector<Loop> largest;
  for (const Loop& reference : loops) {
    const Rigid3& later = map.keyframes.at(reference.later).world_from_cam;
    const Rigid3 expected = Correction(map, reference) * later;
    std::vector<Loop> agreeing;
    for (const Loop& loop : loops) {
      const Rigid3 difference = expected.Inverse() * (Correction(map, loop) * later);
      // Seen from the reference a turn about the other loop's place is a move as well.
      const double away =
          (later.translation - map.keyframes.at(loop.later).world_from_cam.translation).norm();
      if (difference.translation.norm() <= kDistance + options.max_drift * away &&
          difference.Angle() <= options.max_drift_angle) {
        agreeing.push_back(loop);
      }
    }
    if (agreeing.size() > largest.size()) largest = agreeing;
  }
  return largest;
}

// Moves component `from` into the world of the loops' earlier keyframes, and makes it a part of it.
void JoinComponent(const Loop& best, Map& map) {
  const int from = map.keyframes.at(best.later).component;
  const int to = map.keyframes.at(best.earlier).component;
  const Rigid3 correction = Correction(map, best);
  std::map<KeyframeId, Rigid3> poses;
  for (const auto& [id, keyframe] : map.keyframes) {
    if (keyframe.component == from) poses[id] = correction * keyframe.world_from_cam;
  }
  MoveKeyframes(poses, map);
  for (const auto& [id, pose] : poses) map.keyframes.at(id).component = to;
}

nlohmann::json Describe(const Map& map, const Loop& loop) {
  const Eigen::Vector3d& t = loop.earlier_from_later.translation;
  const Eigen::Quaterniond& q = loop.earlier_from_later.rotation;
  const Rigid3 correction = map.keyframes.at(loop.later).world_from_cam.Inverse() *
                            Correction(map, loop) * map.keyframes.at(loop.later).world_from_cam;
  return {{"earlier", loop.earlier},
          {"later", loop.later},
          {"earlier_timestamp_ns", map.keyframes.at(loop.earlier).timestamp_ns},
          {"later_timestamp_ns", map.keyframes.at(loop.later).timestamp_ns},
          {"matches", loop.matches},
          {"inliers", loop.inliers},
          {"earlier_from_later",
           {{"translation_m", {t.x(), t.y(), t.z()}},
            {"quaternion_xyzw", {q.x(), q.y(), q.z(), q.w()}}}},
          {"move_m", correction.translation.norm()},
          {"turn_rad", correction.Angle()}};
}

// The search of one run.
class Search {
 public:
  Search(Map& map, RefineContext& context)
      : map_(map),
        context_(context),
        options_(context.options.loop_closure),
        place_(map, context.vocabulary, nullptr),
        path_(PathLengths(map, context)) {}

  void Run() {
    const int total = static_cast<int>(map_.keyframes.size());
    int done = 0;
    for (const auto& [id, keyframe] : map_.keyframes) {
      Examine(id);
      const std::size_t found = context_.loops.size() + between_.size();
      context_.progress(++done, total, fmt::format("{} loops", found));
    }
    Join();
  }

  nlohmann::json Refusals() const { return refusals_; }
  int candidates() const { return candidates_; }
  int joined() const { return joined_; }

 private:
  void Examine(KeyframeId id) {
    CandidateOptions candidates;
    candidates.min_score_share = options_.min_score_share;
    candidates.min_shared_in_group = options_.min_shared_in_group;
    candidates.max_groups = options_.max_groups;
    const std::vector<ScoredKeyframe> scores = place_.index().Scores(place_.place(id).keypoint_bag);
    for (const ScoredKeyframe& candidate :
         FindLoopCandidates(scores, id, place_.covisibility(), candidates)) {
      ++candidates_;
      std::string refusal;
      auto loop = VerifyLoop(map_, candidate.id, id, *context_.matcher, options_, &refusal);
      const bool within =
          map_.keyframes.at(id).component == map_.keyframes.at(candidate.id).component;
      if (loop && within &&
          !IsPlausible(map_, *loop, path_.at(id) - path_.at(candidate.id), options_)) {
        refusal = "further than odometry drifts";
        loop.reset();
      }
      if (!loop) {
        refusals_[refusal] = refusals_.value(refusal, 0) + 1;
      } else {
        (within ? context_.loops : between_).push_back(std::move(*loop));
      }
    }
  }

  // Joins components as long as enough loops between two of them agree; the most agreeing pair
  // first.
  void Join() {
    while (true) {
      std::map<std::pair<int, int>, std::vector<Loop>> pairs;  // components: earlier, later
      for (const Loop& loop : between_) {
        const int earlier = map_.keyframes.at(loop.earlier).component;
        const int later = map_.keyframes.at(loop.later).component;
        if (earlier != later) pairs[{earlier, later}].push_back(loop);
      }
      std::vector<Loop> most;
      for (const auto& [components, loops] : pairs) {
        const std::vector<Loop> agreeing = LargestAgreement(map_, loops, options_);
        if (agreeing.size() > most.size()) most = agreeing;
      }
      if (static_cast<int>(most.size()) < std::max(1, options_.min_joining_loops)) break;
      const auto best =
          std::max_element(most.begin(), most.end(),
                           [](const Loop& a, const Loop& b) { return a.inliers < b.inliers; });
      JoinComponent(*best, map_);
      ++joined_;
      context_.loops.insert(context_.loops.end(), most.begin(), most.end());
    }
  }

  Map& map_;
  RefineContext& context_;
  const LoopClosureOptions& options_;
  const PlaceIndex place_;
  const std::map<KeyframeId, double> path_;
  std::vector<Loop> between_;  // of different components
  nlohmann::json refusals_ = nlohmann::json::object();
  int candidates_ = 0;
  int joined_ = 0;
};

}  // namespace

void LoopClosure::Process(Map& map, RefineContext& context) {
  if (context.vocabulary == nullptr || context.matcher == nullptr) {
    context.report["skipped"] = "the model pack has no vocabulary or no matcher";
    LogWarn("no loops can be found: the model pack has no vocabulary or no matcher");
    return;
  }
  Search search(map, context);
  search.Run();
  context.report["candidates"] = search.candidates();
  context.report["refused"] = search.Refusals();
  context.report["components_joined"] = search.joined();
  context.report["loops"] = nlohmann::json::array();
  for (const Loop& loop : context.loops) context.report["loops"].push_back(Describe(map, loop));
}

}  // namespace airslam
