// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/bundle.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "airslam/optimize/bound_scale.h"
#include "airslam/optimize/bundle_solver.h"
#include "airslam/optimize/pose_parameter.h"

namespace airslam {
namespace {

// Beyond so many sigmas a loop counts less and less (95 % of its six coordinates' norms lie
// within).
constexpr double kLoopHuber = 3.5;

// The factors of a bundle that are objects: of poses, the IMU and loops.
class Factors {
 public:
  // Throws Error when a covariance is not positive definite, or a link of the IMU spans no time.
  explicit Factors(const BundleProblem& bundle) : bundle_(bundle), inertial_(bundle.inertial) {
    for (const RelativePose& loop : bundle.relative_poses)
      loops_.push_back(std::make_unique<RelativePoseFactor>(loop));
  }

  // Poses are the first unknowns. This must outlive the result.
  KeptFactors ToKept() {
    KeptFactors kept;
    for (std::size_t i = 0; i < bundle_.world_from_cam.size(); ++i) {
      kept.AddUnknown(ToParameter(bundle_.world_from_cam[i]), &pose_manifold_,
                      bundle_.pose_fixed[i]);
    }
    inertial_.AddTo(kept);
    for (std::size_t i = 0; i < loops_.size(); ++i) {
      const RelativePose& loop = bundle_.relative_poses[i];
      kept.AddFactor(*loops_[i], {loop.from, loop.to}, {kLoopHuber});
    }
    return kept;
  }

  const InertialBundle& inertial() const { return inertial_; }

 private:
  const BundleProblem& bundle_;
  PoseManifold pose_manifold_;
  InertialBundle inertial_;
  std::vector<std::unique_ptr<RelativePoseFactor>> loops_;
};

BundleSolver MakeSolver(const BundleProblem& bundle, bool sparse, Factors& factors) {
  BundleSolver::Problem problem{bundle.stereo,       bundle.points_in_world,   {},
                                bundle.observations, bundle.line_observations, sparse};
  for (const PluckerLine& line : bundle.lines_in_world) {
    problem.lines_in_world.push_back(ToParameter(line));
  }
  return {std::move(problem), factors.ToKept()};
}

Rigid3 PoseOf(const BundleSolver& solver, int i) {
  PoseParameter pose;
  std::copy_n(solver.kept(i), pose.size(), pose.begin());
  return FromParameter(pose);
}

// Whether the stretch of a line that was observed lies before the cameras.
bool LiesInFront(const StereoCamera& stereo, const Rigid3& world_from_cam,
                 const PluckerLine& line_in_world, const LineObservation& seen) {
  const Rigid3 left_from_world = world_from_cam.Inverse();
  if (!SegmentSeenAt(stereo.camera, left_from_world * line_in_world, seen.left)) return false;
  if (!seen.right) return true;
  const Rigid3 right_from_left(Eigen::Quaterniond::Identity(), {-stereo.baseline, 0, 0});
  return SegmentSeenAt(stereo.camera, right_from_left * (left_from_world * line_in_world),
                       *seen.right)
      .has_value();
}

// The squares of the residuals of some observations, all of them and those that are no outliers.
struct Errors {
  std::vector<double> squares;  // of each observation
  std::vector<int> rows;        // its coordinates
  double inlier_squares = 0;
  int inlier_coordinates = 0;

  double Rms() const {
    return inlier_coordinates > 0 ? std::sqrt(inlier_squares / inlier_coordinates) : 0;
  }
};

Errors Sum(std::vector<double> squares, const auto& observations,
           const std::vector<bool>& outlier) {
  Errors errors;
  for (std::size_t i = 0; i < squares.size(); ++i) {
    const int rows = observations[i].seen.rows();
    errors.rows.push_back(rows);
    if (outlier[i]) continue;
    errors.inlier_squares += squares[i];
    errors.inlier_coordinates += rows;
  }
  errors.squares = std::move(squares);
  return errors;
}

// What residuals err by more than they show: `unknowns` were fitted to them.
double LostFreedom(const Errors& errors, double unknowns) {
  const double coordinates = errors.inlier_coordinates;
  return coordinates / std::max(coordinates - unknowns, 0.1 * coordinates);
}

double PointUnknowns(const BundleProblem& bundle) {
  return static_cast<double>(3 * bundle.points_in_world.size() + 6 * bundle.world_from_cam.size());
}

double LineUnknowns(const BundleProblem& bundle) {
  return static_cast<double>(4 * bundle.lines_in_world.size());
}

double ScaleOf(const Errors& errors, double unknowns, double least) {
  std::vector<double> means(errors.squares.size());
  for (std::size_t i = 0; i < means.size(); ++i) means[i] = errors.squares[i] / errors.rows[i];
  return BoundScale(std::move(means), LostFreedom(errors, unknowns), least);
}

bool IsOutlier(double squares, int rows, double max_error) {
  return squares * 2 / rows > max_error * max_error;
}

// Which observations lie beyond the bound, what the others err by, and what the bounds were scaled
// by.
struct Verdict {
  std::vector<bool> outlier;
  Errors errors;
  double scale = 1;
};

// `is_outlier`: of an observation by its number, squared residual, coordinates and the bound.
Verdict Judge(std::vector<double> squares, const auto& observations,
              const std::vector<bool>& outlier_before, double unknowns,
              const BundleOptions& options, const auto& is_outlier) {
  Verdict verdict;
  verdict.errors = Sum(std::move(squares), observations, outlier_before);
  verdict.scale = ScaleOf(verdict.errors, unknowns, options.least_scale);
  const double bound = verdict.scale * options.max_error;
  for (std::size_t i = 0; i < verdict.errors.squares.size(); ++i) {
    verdict.outlier.push_back(
        is_outlier(i, verdict.errors.squares[i], verdict.errors.rows[i], bound));
  }
  verdict.errors = Sum(std::move(verdict.errors.squares), observations, verdict.outlier);
  return verdict;
}

Verdict JudgePoints(const BundleProblem& bundle, BundleSolver& solver, const BundleOptions& options,
                    const std::vector<bool>& outlier_before) {
  return Judge(solver.PointErrors(), bundle.observations, outlier_before, PointUnknowns(bundle),
               options, [](std::size_t, double squares, int rows, double bound) {
                 return IsOutlier(squares, rows, bound);
               });
}

Verdict JudgeLines(const BundleProblem& bundle, BundleSolver& solver, const BundleOptions& options,
                   const std::vector<bool>& outlier_before) {
  return Judge(solver.LineErrors(), bundle.line_observations, outlier_before, LineUnknowns(bundle),
               options, [&](std::size_t i, double squares, int rows, double bound) {
                 const LineSeen& o = bundle.line_observations[i];
                 return IsOutlier(squares, rows, bound) ||
                        !LiesInFront(bundle.stereo, PoseOf(solver, o.pose),
                                     LineFromParameter(solver.line_in_world(o.line)), o.seen);
               });
}

// The variance of a pixel coordinate as the residuals show it, in squares of its assumed sigma:
// what the IMU is weighed against. At most 1.
double VisualVariance(const BundleProblem& bundle, const Errors& errors) {
  if (errors.inlier_coordinates == 0) return 1;
  const double mean = errors.Rms() * errors.Rms();
  return std::clamp(mean * LostFreedom(errors, PointUnknowns(bundle)), 0.01, 1.0);
}

void CopyTo(const BundleSolver& solver, BundleProblem& problem) {
  for (std::size_t i = 0; i < problem.world_from_cam.size(); ++i) {
    if (!problem.pose_fixed[i]) problem.world_from_cam[i] = PoseOf(solver, static_cast<int>(i));
  }
  for (std::size_t i = 0; i < problem.points_in_world.size(); ++i) {
    problem.points_in_world[i] = solver.point_in_world(static_cast<int>(i));
  }
  for (std::size_t i = 0; i < problem.lines_in_world.size(); ++i) {
    problem.lines_in_world[i] = LineFromParameter(solver.line_in_world(static_cast<int>(i)));
  }
}

}  // namespace

BundleSummary SolveBundle(const BundleOptions& options, BundleProblem* problem) {
  Factors factors(*problem);
  BundleSolver solver = MakeSolver(*problem, options.sparse, factors);
  BundleSummary summary;
  summary.outlier.assign(problem->observations.size(), false);
  summary.line_outlier.assign(problem->line_observations.size(), false);
  Errors points = Sum(solver.PointErrors(), problem->observations, summary.outlier);
  summary.initial_rms = points.Rms();
  BundleSolver::Rules rules{.function_tolerance = options.function_tolerance,
                            .point_loss = {options.huber},
                            .line_loss = {options.huber}};
  int first_iteration = 0;
  for (const int iterations : {options.robust_iterations, options.final_iterations}) {
    rules.max_iterations = iterations;
    rules.kept_weight = VisualVariance(*problem, points);
    rules.on_iteration = [&](int i) {
      if (options.on_iteration) options.on_iteration(first_iteration + i);
    };
    summary.iterations += solver.Solve(rules);
    first_iteration += iterations;
    Verdict of_points = JudgePoints(*problem, solver, options, summary.outlier);
    points = std::move(of_points.errors);
    summary.outlier = std::move(of_points.outlier);
    rules.point_loss = {of_points.scale * options.huber};
    Verdict of_lines = JudgeLines(*problem, solver, options, summary.line_outlier);
    summary.line_rms = of_lines.errors.Rms();
    summary.line_outlier = std::move(of_lines.outlier);
    rules.line_loss = {of_lines.scale * options.huber};
    solver.SetOutliers(summary.outlier, summary.line_outlier);
  }
  summary.final_rms = points.Rms();
  CopyTo(solver, *problem);
  factors.inertial().CopyTo([&](int unknown) { return solver.kept(unknown); }, problem->inertial);
  return summary;
}

}  // namespace airslam
