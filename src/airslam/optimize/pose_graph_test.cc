// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/pose_graph.h"

#include <gtest/gtest.h>

#include <cmath>

#include "airslam/geometry/so3.h"

namespace airslam {
namespace {

constexpr int kPoses = 40;

// A round trip that ends where it began, looking ahead.
std::vector<Rigid3> RoundTrip() {
  std::vector<Rigid3> poses;
  for (int i = 0; i < kPoses; ++i) {
    const double angle = 2 * std::acos(-1.0) * i / (kPoses - 1);
    poses.emplace_back(ExpSO3({0, 0, angle}),
                       Eigen::Vector3d(5 * std::cos(angle), 5 * std::sin(angle), 1));
  }
  return poses;
}

Matrix6d Covariance(double angle, double distance) {
  Matrix6d covariance = Matrix6d::Identity();
  covariance.topLeftCorner<3, 3>() *= angle * angle;
  covariance.bottomRightCorner<3, 3>() *= distance * distance;
  return covariance;
}

// The trip as odometry sees it: every step turns and moves a little too far.
PoseGraphProblem Drifting() {
  const std::vector<Rigid3> truth = RoundTrip();
  PoseGraphProblem graph;
  graph.poses = {truth[0]};
  for (int i = 1; i < kPoses; ++i) {
    const Rigid3 step = truth[i - 1].Inverse() * truth[i] *
                        Rigid3(ExpSO3({0.001, 0, 0.003}), Eigen::Vector3d(0.002, 0.004, 0.003));
    graph.edges.push_back({i - 1, i, step, Covariance(0.003, 0.006)});
    graph.poses.push_back(graph.poses.back() * step);
  }
  graph.fixed.assign(kPoses, false);
  graph.fixed[0] = true;
  return graph;
}

double WorstError(const PoseGraphProblem& graph) {
  const std::vector<Rigid3> truth = RoundTrip();
  double worst = 0;
  for (int i = 0; i < kPoses; ++i) {
    worst = std::max(worst, (graph.poses[i].translation - truth[i].translation).norm());
  }
  return worst;
}

TEST(PoseGraph, ALoopTakesTheDriftAway) {
  PoseGraphProblem graph = Drifting();
  const double before = WorstError(graph);
  ASSERT_GT(before, 0.2);
  const std::vector<Rigid3> truth = RoundTrip();
  graph.edges.push_back(
      {0, kPoses - 1, truth.front().Inverse() * truth.back(), Covariance(1e-3, 5e-3)});
  const PoseGraphSummary summary = SolvePoseGraph({}, &graph);
  EXPECT_LT(WorstError(graph), 0.35 * before);
  EXPECT_LT((graph.poses.back().translation - truth.back().translation).norm(), 0.05);
  EXPECT_LT(summary.final_rms, 0.2 * summary.initial_rms);
  EXPECT_EQ(graph.poses[0].translation, truth[0].translation) << "the first one stays";
}

TEST(PoseGraph, OneWrongLoopDoesNotBendIt) {
  PoseGraphProblem graph = Drifting();
  const std::vector<Rigid3> truth = RoundTrip();
  for (int i = 0; i < 4; ++i) {
    graph.edges.push_back(
        {i, kPoses - 1 - i, truth[i].Inverse() * truth[kPoses - 1 - i], Covariance(1e-3, 5e-3)});
  }
  PoseGraphProblem with_wrong = graph;
  SolvePoseGraph({}, &graph);
  with_wrong.edges.push_back({10, 30, Rigid3(), Covariance(0.01, 0.05)});
  SolvePoseGraph({}, &with_wrong);
  EXPECT_LT(WorstError(with_wrong), WorstError(graph) + 0.6);
}

TEST(PoseGraph, WithoutLoopsNothingMoves) {
  PoseGraphProblem graph = Drifting();
  const PoseGraphProblem before = graph;
  SolvePoseGraph({}, &graph);
  for (int i = 0; i < kPoses; ++i) {
    EXPECT_LT((graph.poses[i].translation - before.poses[i].translation).norm(), 1e-9);
  }
}

TEST(PoseGraph, RepeatsBitByBitAndReportsIterations) {
  PoseGraphProblem a = Drifting();
  const std::vector<Rigid3> truth = RoundTrip();
  a.edges.push_back(
      {0, kPoses - 1, truth.front().Inverse() * truth.back(), Covariance(1e-3, 5e-3)});
  PoseGraphProblem b = a;
  int last = -1;
  PoseGraphOptions options;
  options.on_iteration = [&](int iteration) { last = iteration; };
  SolvePoseGraph(options, &a);
  SolvePoseGraph({}, &b);
  EXPECT_GT(last, 0);
  for (int i = 0; i < kPoses; ++i) {
    EXPECT_EQ(a.poses[i].translation, b.poses[i].translation);
    EXPECT_EQ(a.poses[i].rotation.coeffs(), b.poses[i].rotation.coeffs());
  }
}

TEST(PoseGraph, AcceptsNoEdges) {
  PoseGraphProblem graph{{Rigid3()}, {true}, {}};
  EXPECT_EQ(SolvePoseGraph({}, &graph).iterations, 0);
}

}  // namespace
}  // namespace airslam
