// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <span>
#include <vector>

#include "airslam/optimize/damping.h"
#include "airslam/optimize/kept_factors.h"
#include "airslam/optimize/landmark_elimination.h"
#include "airslam/optimize/line_manifold.h"
#include "airslam/optimize/line_residual.h"
#include "airslam/optimize/point_residual.h"
#include "airslam/optimize/reduced_system.h"

namespace airslam {

// Levenberg-Marquardt with the Schur complement for bundle adjustment: points and lines are
// eliminated with blocks of fixed size, poses and what hangs on them is solved for. It minimizes
// what Ceres would with PointFactor and LineFactor, by the same rules of damping, but has the
// derivatives by the tangents at once and no object a residual: docs/factors.md, "The solver".
//
// The structure is made once; then each Solve goes on from where the last one ended. One thread,
// sums in a fixed order: the same input gives the same bits. Iterations allocate nothing but what
// Eigen's decompositions do.
class BundleSolver {
 public:
  struct Problem {
    StereoCamera stereo;
    std::span<const Eigen::Vector3d> points_in_world;
    std::vector<LineParameter> lines_in_world;
    std::span<const PointSeen> points_seen;
    std::span<const LineSeen> lines_seen;
    bool sparse = false;  // whether the poses' equations are mostly zeros
  };
  struct Rules {
    int max_iterations = 10;
    double function_tolerance = 1e-4;  // of the cost: a step that changes it by less is the last
    Huber point_loss, line_loss;
    double kept_weight = 1;                           // of the squares of the kept factors
    std::function<void(int)> on_iteration = nullptr;  // called with 0, 1, ...
  };

  // The first unknowns of `kept` are the poses, PoseParameters with the PoseManifold. Observations
  // must live as long as this.
  BundleSolver(Problem problem, KeptFactors kept);

  // Leaves out the observations that are true here (one a point or line seen).
  void SetOutliers(const std::vector<bool>& points, const std::vector<bool>& lines);
  // Returns how many steps were tried.
  int Solve(const Rules& rules);
  // Half the sum of robust squares, as it is now.
  double Cost(const Rules& rules) { return Cost(now_, rules); }

  // Squared residuals of all observations, outliers too, as they are now.
  std::vector<double> PointErrors();
  std::vector<double> LineErrors();

  const double* kept(int unknown) const { return now_.kept.data() + kept_.offset(unknown); }
  const Eigen::Vector3d& point_in_world(int i) const { return now_.points[i]; }
  const LineParameter& line_in_world(int i) const { return now_.lines[i]; }

 private:
  struct State {
    std::vector<double> kept;
    std::vector<Eigen::Vector3d> points;
    std::vector<LineParameter> lines;
  };
  using Points = LandmarkElimination<3>;
  using Lines = LandmarkElimination<4>;

  void UpdateViews(const State& state);
  // Calls visit(observation, squared residual) for each observation of a point or line.
  template <class Visit>
  void VisitPoints(const State& state, const Visit& visit);
  template <class Visit>
  void VisitLines(const State& state, const Visit& visit);
  double Cost(const State& state, const Rules& rules);
  void Linearize(const Rules& rules);
  // Add observation i of a landmark.
  void AddPoint(const Eigen::Vector3d& point, const Huber& loss, int i, Points::Landmark& landmark);
  void AddLine(const LineInWorld& line, const Huber& loss, int i, Lines::Landmark& landmark);
  // Solves for the step and writes where it leads into next_. Returns by how much it lowers the
  // model's cost, negative when there is no step.
  double Step();

  Problem problem_;
  KeptFactors kept_;
  ReducedSystem system_;
  Points points_;
  Lines lines_;
  State now_, next_;
  Damping damping_;
  std::vector<CameraView> views_;  // of the poses
  Eigen::VectorXd kept_damping_, kept_gradient_, kept_step_;
};

}  // namespace airslam
