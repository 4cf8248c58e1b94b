// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/refine/pose_graph_processor.h"

#include <set>

#include "airslam/optimize/pose_graph.h"
#include "airslam/refine/map_tools.h"

namespace airslam {
namespace {

Matrix6d OdometryCovariance(const PoseGraphProcessorOptions& options, const Rigid3& motion) {
  const double position =
      options.position_share * motion.translation.norm() + options.position_sigma;
  Matrix6d covariance = Matrix6d::Zero();
  covariance.diagonal().head<3>().setConstant(options.rotation_sigma * options.rotation_sigma);
  covariance.diagonal().tail<3>().setConstant(position * position);
  return covariance;
}

PoseGraphProblem MakeGraph(const Map& map, const RefineContext& context) {
  PoseGraphProblem graph;
  std::map<KeyframeId, int> positions;
  std::set<int> components;
  for (const auto& [id, keyframe] : map.keyframes) {
    positions[id] = static_cast<int>(graph.poses.size());
    graph.poses.push_back(keyframe.world_from_cam);
    graph.fixed.push_back(components.insert(keyframe.component).second);
  }
  for (const OdometryEdge& edge : context.odometry) {
    if (!positions.contains(edge.from) || !positions.contains(edge.to)) continue;
    graph.edges.push_back({positions[edge.from], positions[edge.to], edge.from_from_to,
                           OdometryCovariance(context.options.pose_graph, edge.from_from_to)});
  }
  for (const Loop& loop : context.loops) {
    if (!positions.contains(loop.earlier) || !positions.contains(loop.later)) continue;
    graph.edges.push_back(
        {positions[loop.earlier], positions[loop.later], loop.earlier_from_later, loop.covariance});
  }
  return graph;
}

}  // namespace

void PoseGraphProcessor::Process(Map& map, RefineContext& context) {
  const PoseGraphProcessorOptions& options = context.options.pose_graph;
  if (context.loops.empty()) {
    context.report["skipped"] = "no loops";
    return;
  }
  if (static_cast<int>(map.landmarks.size()) < options.min_landmarks) {
    context.report["skipped"] = "fewer landmarks than pose_graph.min_landmarks";
    return;
  }
  PoseGraphProblem graph = MakeGraph(map, context);
  PoseGraphOptions solver;
  solver.iterations = options.iterations;
  solver.on_iteration = [&](int iteration) {
    context.progress(iteration, options.iterations, "iterations");
  };
  const PoseGraphSummary summary = SolvePoseGraph(solver, &graph);
  std::map<KeyframeId, Rigid3> poses;
  int position = 0;
  double largest = 0;
  for (const auto& [id, keyframe] : map.keyframes) {
    const Rigid3& pose = graph.poses[position++];
    largest = std::max(largest, (pose.translation - keyframe.world_from_cam.translation).norm());
    poses[id] = pose;
  }
  MoveKeyframes(poses, map);
  context.report["edges"] = graph.edges.size();
  context.report["iterations"] = summary.iterations;
  context.report["rms_sigmas_before"] = summary.initial_rms;
  context.report["rms_sigmas_after"] = summary.final_rms;
  context.report["largest_move_m"] = largest;
}

}  // namespace airslam
