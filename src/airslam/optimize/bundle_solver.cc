// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/bundle_solver.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace airslam {
namespace {

using Block66 = Eigen::Map<Eigen::Matrix<double, 6, 6>>;

std::vector<LandmarkElimination<3>::Seen> WhoSees(std::span<const PointSeen> seen,
                                                  const KeptFactors& kept) {
  std::vector<LandmarkElimination<3>::Seen> list;
  for (const PointSeen& o : seen) list.push_back({o.point, o.pose, kept.equation(o.pose)});
  return list;
}

std::vector<LandmarkElimination<4>::Seen> WhoSees(std::span<const LineSeen> seen,
                                                  const KeptFactors& kept) {
  std::vector<LandmarkElimination<4>::Seen> list;
  for (const LineSeen& o : seen) list.push_back({o.line, o.pose, kept.equation(o.pose)});
  return list;
}

}  // namespace

BundleSolver::BundleSolver(Problem problem, KeptFactors kept)
    : problem_(std::move(problem)),
      kept_(std::move(kept)),
      system_(kept_.sizes(), problem_.sparse),
      points_(static_cast<int>(problem_.points_in_world.size()),
              WhoSees(problem_.points_seen, kept_)),
      lines_(static_cast<int>(problem_.lines_in_world.size()), WhoSees(problem_.lines_seen, kept_)),
      now_{kept_.start(),
           {problem_.points_in_world.begin(), problem_.points_in_world.end()},
           problem_.lines_in_world},
      next_(now_) {
  kept_.AddStructure(system_);
  points_.AddStructure(system_);
  lines_.AddStructure(system_);
  system_.FinishStructure();
  kept_damping_.resize(system_.rows());
  kept_step_.resize(system_.rows());
  int poses = 0;
  for (const PointSeen& o : problem_.points_seen) poses = std::max(poses, o.pose + 1);
  for (const LineSeen& o : problem_.lines_seen) poses = std::max(poses, o.pose + 1);
  views_.resize(poses);
}

void BundleSolver::SetOutliers(const std::vector<bool>& points, const std::vector<bool>& lines) {
  for (Points::Observation& o : points_.observations()) o.used = !points[o.source];
  for (Lines::Observation& o : lines_.observations()) o.used = !lines[o.source];
}

void BundleSolver::UpdateViews(const State& state) {
  for (std::size_t i = 0; i < views_.size(); ++i) {
    views_[i] = CameraView(state.kept.data() + kept_.offset(static_cast<int>(i)));
  }
}

template <class Visit>
void BundleSolver::VisitPoints(const State& state, const Visit& visit) {
  for (const Points::Observation& o : points_.observations()) {
    const PointSeen& seen = problem_.points_seen[o.source];
    const PointResidual residual(problem_.stereo, seen.seen, views_[o.pose],
                                 state.points[seen.point]);
    visit(o, residual.values.squaredNorm());
  }
}

template <class Visit>
void BundleSolver::VisitLines(const State& state, const Visit& visit) {
  for (std::size_t l = 0; l < state.lines.size(); ++l) {
    const LineInWorld line(state.lines[l].data());
    const Lines::Landmark& landmark = lines_.landmarks()[l];
    for (int i = landmark.begin; i < landmark.end; ++i) {
      const Lines::Observation& o = lines_.observations()[i];
      const LineResidual residual(problem_.stereo, problem_.lines_seen[o.source].seen,
                                  views_[o.pose], line, false);
      visit(o, residual.values.squaredNorm());
    }
  }
}

std::vector<double> BundleSolver::PointErrors() {
  std::vector<double> errors(problem_.points_seen.size());
  UpdateViews(now_);
  VisitPoints(now_, [&](const Points::Observation& o, double e) { errors[o.source] = e; });
  return errors;
}

std::vector<double> BundleSolver::LineErrors() {
  std::vector<double> errors(problem_.lines_seen.size());
  UpdateViews(now_);
  VisitLines(now_, [&](const Lines::Observation& o, double e) { errors[o.source] = e; });
  return errors;
}

double BundleSolver::Cost(const State& state, const Rules& rules) {
  double sum = 0;
  const auto add = [&](const Huber& loss) {
    return [&](const auto& o, double squares) {
      if (o.used) sum += loss.Cost(squares);
    };
  };
  UpdateViews(state);
  VisitPoints(state, add(rules.point_loss));
  VisitLines(state, add(rules.line_loss));
  return 0.5 * sum + kept_.Cost(state.kept, rules.kept_weight);
}

// With A the derivatives by the point, those by the pose are A [2 [d]x, -I], d = point - centre, so
// that all blocks come from N = A'A and h = A'r.
void BundleSolver::AddPoint(const Eigen::Vector3d& point, const Huber& loss, int i,
                            Points::Landmark& landmark) {
  const Points::Observation& observation = points_.observations()[i];
  if (!observation.used) return;
  const PointObservation& seen = problem_.points_seen[observation.source].seen;
  const CameraView& view = views_[observation.pose];
  const PointResidual residual(problem_.stereo, seen, view, point);
  const double weight = loss.Weight(residual.values.squaredNorm());
  const Eigen::Matrix3d by_point = residual.ByPoint(problem_.stereo, seen, view);
  const Eigen::Matrix3d n = weight * by_point.transpose().lazyProduct(by_point);
  const Eigen::Vector3d h = weight * by_point.transpose().lazyProduct(residual.values);
  landmark.information += n;
  landmark.gradient -= h;
  if (observation.equation < 0) return;
  const Eigen::Vector3d d = 2 * residual.from_centre;
  Points::Coupling& w = points_.coupling(i);
  for (int c = 0; c < 3; ++c) w.col(c) << n.col(c).cross(d), -n.col(c);
  Block66 pose(system_.values() + system_.diagonal(observation.equation));
  pose.col(0) += d.z() * w.col(1) - d.y() * w.col(2);
  pose.col(1) += d.x() * w.col(2) - d.z() * w.col(0);
  pose.col(2) += d.y() * w.col(0) - d.x() * w.col(1);
  pose.rightCols<3>() -= w;
  auto gradient = system_.gradient().segment<6>(system_.start(observation.equation));
  gradient.head<3>() += d.cross(h);
  gradient.tail<3>() += h;
}

void BundleSolver::AddLine(const LineInWorld& line, const Huber& loss, int i,
                           Lines::Landmark& landmark) {
  const Lines::Observation& observation = lines_.observations()[i];
  if (!observation.used) return;
  const LineResidual residual(problem_.stereo, problem_.lines_seen[observation.source].seen,
                              views_[observation.pose], line, true);
  const double weight = loss.Weight(residual.values.squaredNorm());
  const Eigen::Matrix4d weighted_by_line = weight * residual.by_line.transpose();
  landmark.information += weighted_by_line.lazyProduct(residual.by_line);
  landmark.gradient -= weighted_by_line.lazyProduct(residual.values);
  if (observation.equation < 0) return;
  const Eigen::Matrix<double, 6, 4> weighted_by_pose = weight * residual.by_pose.transpose();
  lines_.coupling(i) = weighted_by_pose.lazyProduct(residual.by_line);
  Block66 pose(system_.values() + system_.diagonal(observation.equation));
  pose += weighted_by_pose.lazyProduct(residual.by_pose);
  system_.gradient().segment<6>(system_.start(observation.equation)) -=
      weighted_by_pose.lazyProduct(residual.values);
}

void BundleSolver::Linearize(const Rules& rules) {
  const auto clear = [](auto& landmark) {
    landmark.information.setZero();
    landmark.gradient.setZero();
  };
  system_.SetZero();
  UpdateViews(now_);
  kept_.Linearize(now_.kept, rules.kept_weight, system_);
  for (std::size_t l = 0; l < now_.points.size(); ++l) {
    Points::Landmark& landmark = points_.landmarks()[l];
    clear(landmark);
    for (int i = landmark.begin; i < landmark.end; ++i) {
      AddPoint(now_.points[l], rules.point_loss, i, landmark);
    }
  }
  for (std::size_t l = 0; l < now_.lines.size(); ++l) {
    Lines::Landmark& landmark = lines_.landmarks()[l];
    const LineInWorld line(now_.lines[l].data());
    clear(landmark);
    for (int i = landmark.begin; i < landmark.end; ++i) AddLine(line, rules.line_loss, i, landmark);
  }
}

double BundleSolver::Step() {
  // Both are wanted as they are before landmarks are eliminated.
  for (std::size_t i = 0; i < kept_.sizes().size(); ++i) {
    const int unknown = static_cast<int>(i), size = system_.size(unknown);
    const Eigen::Map<const Eigen::MatrixXd> block(system_.values() + system_.diagonal(unknown),
                                                  size, size);
    kept_damping_.segment(system_.start(unknown), size) = damping_.Of(block.diagonal());
  }
  kept_gradient_ = system_.gradient();
  for (Points::Landmark& landmark : points_.landmarks()) {
    if (!points_.Eliminate(landmark, damping_, system_)) return -1;
  }
  for (Lines::Landmark& landmark : lines_.landmarks()) {
    if (!lines_.Eliminate(landmark, damping_, system_)) return -1;
  }
  if (!system_.Solve(kept_damping_, &kept_step_)) return -1;
  double decrease = Damping::Decrease(kept_step_, kept_gradient_, kept_damping_);
  kept_.Plus(now_.kept, kept_step_, system_, &next_.kept);
  for (std::size_t i = 0; i < now_.points.size(); ++i) {
    Points::Landmark& landmark = points_.landmarks()[i];
    decrease += points_.BackSubstitute(landmark, system_, kept_step_);
    next_.points[i] = now_.points[i] + landmark.step;
  }
  const LineManifold manifold;
  for (std::size_t i = 0; i < now_.lines.size(); ++i) {
    Lines::Landmark& landmark = lines_.landmarks()[i];
    decrease += lines_.BackSubstitute(landmark, system_, kept_step_);
    manifold.Plus(now_.lines[i].data(), landmark.step.data(), next_.lines[i].data());
  }
  return decrease;
}

int BundleSolver::Solve(const Rules& rules) {
  damping_ = {};
  double cost = Cost(now_, rules);
  for (int i = 0; i < rules.max_iterations; ++i) {
    Linearize(rules);
    const double expected = Step();
    const double next_cost = expected > 0 ? Cost(next_, rules) : cost;
    if (rules.on_iteration) rules.on_iteration(i);
    // Nothing is left to gain where equations could be solved and yet foresee none.
    if (expected == 0) return i + 1;
    const double change = cost - next_cost;
    if (damping_.Judge(change / expected)) {
      std::swap(now_, next_);
      cost = next_cost;
    }
    if (expected > 0 && std::abs(change) <= rules.function_tolerance * cost) return i + 1;
  }
  return rules.max_iterations;
}

}  // namespace airslam
