// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/refine/global_bundle.h"

#include <cmath>
#include <set>

#include "airslam/feature/point_line_association.h"
#include "airslam/optimize/bundle.h"
#include "airslam/refine/map_inertia.h"
#include "airslam/refine/map_tools.h"

namespace airslam {
namespace {

// A bundle, and whom its parts belong to.
struct GlobalProblem {
  std::vector<KeyframeId> keyframes;          // of problem.world_from_cam
  std::vector<LandmarkId> landmarks;          // of problem.points_in_world
  std::vector<FeatureRef> observations;       // of problem.observations
  std::vector<LandmarkId> line_landmarks;     // of problem.lines_in_world
  std::vector<FeatureRef> line_observations;  // of problem.line_observations
  BundleProblem problem;
  std::map<KeyframeId, int> positions;  // of keyframes
};

void AddKeyframes(const Map& map, GlobalProblem& global) {
  std::set<int> components;
  for (const auto& [id, keyframe] : map.keyframes) {
    global.positions[id] = static_cast<int>(global.keyframes.size());
    global.keyframes.push_back(id);
    global.problem.world_from_cam.push_back(keyframe.world_from_cam);
    global.problem.pose_fixed.push_back(components.insert(keyframe.component).second);
  }
}

// Whether keyframes saw a landmark on two visits. Odometry follows a landmark from keyframe to
// keyframe, so that its observers follow each other but for single outliers.
bool WasRevisited(const std::vector<FeatureRef>& observations) {
  constexpr KeyframeId kGap = 5;
  for (std::size_t i = 1; i < observations.size(); ++i) {
    if (observations[i].keyframe - observations[i - 1].keyframe > kGap) return true;
  }
  return false;
}

void AddPoints(const Map& map, const GlobalBundleOptions& options, GlobalProblem& global) {
  for (const auto& [landmark, observations] : CollectObservations(map)) {
    if (observations.size() < 2 || !map.landmarks.contains(landmark)) continue;
    const int point = static_cast<int>(global.landmarks.size());
    global.landmarks.push_back(landmark);
    global.problem.points_in_world.push_back(map.landmarks.at(landmark).point_in_world);
    const double sigma = WasRevisited(observations) ? options.revisit_sigma : options.pixel_sigma;
    for (const FeatureRef& observation : observations) {
      const Keyframe& keyframe = map.keyframes.at(observation.keyframe);
      const Keypoint& keypoint = keyframe.keypoints[observation.index];
      global.observations.push_back(observation);
      global.problem.observations.push_back(
          {global.positions.at(observation.keyframe), point,
           PointObservation{{keypoint.x, keypoint.y}, keyframe.right_x[observation.index], sigma}});
    }
  }
}

LineObservation ObservationOf(const Keyframe& keyframe, int line, double sigma) {
  LineObservation seen{ToImageSegment(keyframe.lines[line]), std::nullopt, sigma};
  if (keyframe.right_lines[line].score >= 0)
    seen.right = ToImageSegment(keyframe.right_lines[line]);
  return seen;
}

void AddLines(const Map& map, double sigma, GlobalProblem& global) {
  std::map<LandmarkId, std::vector<FeatureRef>> seen_by;
  for (const auto& [id, keyframe] : map.keyframes) {
    for (std::size_t i = 0; i < keyframe.line_landmarks.size(); ++i) {
      if (!map.line_landmarks.contains(keyframe.line_landmarks[i])) continue;
      seen_by[keyframe.line_landmarks[i]].push_back({id, static_cast<int>(i)});
    }
  }
  for (const auto& [landmark, observations] : seen_by) {
    if (observations.front().keyframe == observations.back().keyframe) continue;
    const int line = static_cast<int>(global.line_landmarks.size());
    global.line_landmarks.push_back(landmark);
    global.problem.lines_in_world.push_back(map.line_landmarks.at(landmark).line_in_world());
    for (const FeatureRef& observation : observations) {
      global.line_observations.push_back(observation);
      global.problem.line_observations.push_back(
          {global.positions.at(observation.keyframe), line,
           ObservationOf(map.keyframes.at(observation.keyframe), observation.index, sigma)});
    }
  }
}

void AddLoops(const RefineContext& context, GlobalProblem& global) {
  for (const Loop& loop : context.loops) {
    if (loop.merged) continue;
    const auto earlier = global.positions.find(loop.earlier);
    const auto later = global.positions.find(loop.later);
    if (earlier == global.positions.end() || later == global.positions.end()) continue;
    global.problem.relative_poses.push_back(
        {earlier->second, later->second, loop.earlier_from_later, loop.covariance});
  }
}

// Takes over a solved bundle; returns how many observations were outliers.
int Apply(const GlobalProblem& global, const BundleSummary& summary, Map& map) {
  std::map<KeyframeId, Rigid3> poses;
  for (std::size_t i = 0; i < global.keyframes.size(); ++i) {
    poses[global.keyframes[i]] = global.problem.world_from_cam[i];
  }
  MoveKeyframes(poses, map);  // takes along what was not part of it
  for (std::size_t i = 0; i < global.landmarks.size(); ++i) {
    map.landmarks.at(global.landmarks[i]).point_in_world = global.problem.points_in_world[i];
  }
  int outliers = 0;
  for (std::size_t i = 0; i < global.observations.size(); ++i) {
    if (!summary.outlier[i]) continue;
    const FeatureRef& observation = global.observations[i];
    map.keyframes.at(observation.keyframe).landmarks[observation.index] = kNoLandmark;
    ++outliers;
  }
  return outliers;
}

// The same of lines: each keeps the stretch that it had, moved onto where it is now.
int ApplyLines(const GlobalProblem& global, const BundleSummary& summary, Map& map) {
  for (std::size_t i = 0; i < global.line_landmarks.size(); ++i) {
    const PluckerLine& line = global.problem.lines_in_world[i];
    SpaceSegment& ends = map.line_landmarks.at(global.line_landmarks[i]).ends_in_world;
    const SpaceSegment moved{line.Closest(ends.start), line.Closest(ends.end)};
    const double length = (moved.end - moved.start).norm();
    if (std::isfinite(length) && length > 0) ends = moved;
  }
  int outliers = 0;
  for (std::size_t i = 0; i < global.line_observations.size(); ++i) {
    if (!summary.line_outlier[i]) continue;
    const FeatureRef& observation = global.line_observations[i];
    map.keyframes.at(observation.keyframe).line_landmarks[observation.index] = kNoLandmark;
    ++outliers;
  }
  return outliers;
}

BundleOptions SolverOptions(RefineContext& context) {
  const GlobalBundleOptions& options = context.options.global_bundle;
  BundleOptions solver;
  solver.robust_iterations = options.rough_iterations;
  solver.final_iterations = options.fine_iterations;
  solver.huber = options.huber;
  solver.max_error = options.max_error;
  solver.function_tolerance = 1e-6;
  solver.sparse = true;
  solver.on_iteration = [&context, &options](int iteration) {
    context.progress(iteration, options.rough_iterations + options.fine_iterations,
                     iteration < options.rough_iterations ? "rough" : "fine");
  };
  return solver;
}

}  // namespace

void GlobalBundle::Process(Map& map, RefineContext& context) {
  GlobalProblem global;
  global.problem.stereo = map.calibration.stereo;
  AddKeyframes(map, global);
  AddPoints(map, context.options.global_bundle, global);
  AddLines(map, context.options.global_bundle.line_sigma, global);
  AddLoops(context, global);
  if (global.observations.empty()) {
    context.report["skipped"] = "no landmark is seen by two keyframes";
    return;
  }
  if (context.options.global_bundle.use_imu) {
    global.problem.inertial = CollectInertialTerms(map, global.positions);
  }
  const BundleSummary summary = SolveBundle(SolverOptions(context), &global.problem);
  context.report["keyframes"] = global.keyframes.size();
  context.report["landmarks"] = global.landmarks.size();
  context.report["observations"] = global.observations.size();
  context.report["loops"] = global.problem.relative_poses.size();
  context.report["iterations"] = summary.iterations;
  context.report["rms_sigmas_before"] = summary.initial_rms;
  context.report["rms_sigmas_after"] = summary.final_rms;
  context.report["outliers"] = Apply(global, summary, map);
  context.report["lines"] = global.line_landmarks.size();
  context.report["line_outliers"] = ApplyLines(global, summary, map);
  ApplyInertialTerms(global.problem.inertial, global.keyframes, map);
  context.report["inertial_links"] = global.problem.inertial.links.size();
  context.report["landmarks_removed"] = RemoveUnseenLandmarks(map);
}

}  // namespace airslam
