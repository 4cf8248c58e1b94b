// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/bundle.h"

#include <ceres/loss_function.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "airslam/optimize/iteration_callback.h"
#include "airslam/optimize/pose_parameter.h"

namespace airslam {
namespace {

// The factors of one problem, in the order of its observations.
struct Factors {
  std::vector<std::unique_ptr<PointFactor>> points;
  std::vector<std::unique_ptr<LineFactor>> lines;
};

// The parameter blocks that Ceres moves. Points (3 each), then lines (6 each) lie in one array:
// both are eliminated first, and Ceres orders the blocks of one elimination group by their address.
class Parameters {
 public:
  explicit Parameters(const BundleProblem& bundle)
      : landmarks_(3 * bundle.points_in_world.size() + 6 * bundle.lines_in_world.size()),
        first_line_(3 * bundle.points_in_world.size()) {
    for (const Rigid3& pose : bundle.world_from_cam) poses.push_back(ToParameter(pose));
    for (std::size_t i = 0; i < bundle.points_in_world.size(); ++i) {
      Eigen::Map<Eigen::Vector3d>(point(static_cast<int>(i))) = bundle.points_in_world[i];
    }
    for (std::size_t i = 0; i < bundle.lines_in_world.size(); ++i) {
      const LineParameter parameter = ToParameter(bundle.lines_in_world[i]);
      std::copy(parameter.begin(), parameter.end(), line(static_cast<int>(i)));
    }
  }

  double* point(int i) { return landmarks_.data() + 3 * i; }
  double* line(int i) { return landmarks_.data() + first_line_ + 6 * i; }
  PluckerLine LineInWorld(int i) {
    LineParameter parameter;
    std::copy_n(line(i), 6, parameter.begin());
    return LineFromParameter(parameter);
  }

  std::vector<PoseParameter> poses;

 private:
  std::vector<double> landmarks_;
  std::size_t first_line_;
};

// Beyond so many sigmas a loop counts less and less (95 % of its six coordinates' norms lie
// within).
constexpr double kLoopHuber = 3.5;

// What one round of solving takes besides the problem.
struct Round {
  const BundleOptions& options;
  const BundleSummary& so_far;  // outliers are left out
  int iterations;
  int first_iteration;     // for reports of progress
  double visual_variance;  // of a pixel coordinate, in squares of its assumed sigma
};

// Adds the observations that are no outliers; landmarks are eliminated first, then poses.
void AddVision(const BundleProblem& bundle, const Factors& factors, const Round& round,
               ceres::LossFunction& loss, Parameters& parameters, ceres::Problem& problem,
               ceres::ParameterBlockOrdering& ordering) {
  const auto add = [&](ceres::CostFunction* factor, int pose, double* landmark) {
    double* pose_block = parameters.poses[pose].data();
    problem.AddResidualBlock(factor, &loss, pose_block, landmark);
    ordering.AddElementToGroup(landmark, 0);
    ordering.AddElementToGroup(pose_block, 1);
  };
  for (std::size_t i = 0; i < factors.points.size(); ++i) {
    const BundleProblem::Observation& o = bundle.observations[i];
    if (!round.so_far.outlier[i]) add(factors.points[i].get(), o.pose, parameters.point(o.point));
  }
  for (std::size_t i = 0; i < factors.lines.size(); ++i) {
    const BundleProblem::LineSeen& o = bundle.line_observations[i];
    if (!round.so_far.line_outlier[i]) {
      add(factors.lines[i].get(), o.pose, parameters.line(o.line));
    }
  }
  for (std::size_t i = 0; i < bundle.lines_in_world.size(); ++i) {
    double* line = parameters.line(static_cast<int>(i));
    if (problem.HasParameterBlock(line)) problem.SetManifold(line, new LineManifold);
  }
}

// The factors of loops in a problem.
class Loops {
 public:
  // `weight`: of their squares, as that of the inertial terms.
  Loops(const BundleProblem& bundle, std::vector<PoseParameter>& poses, double weight,
        ceres::Problem& problem, ceres::ParameterBlockOrdering& ordering)
      : loss_(new ceres::HuberLoss(kLoopHuber), weight, ceres::TAKE_OWNERSHIP) {
    for (const RelativePose& loop : bundle.relative_poses) {
      factors_.push_back(std::make_unique<RelativePoseFactor>(loop));
      double* from = poses[loop.from].data();
      double* to = poses[loop.to].data();
      problem.AddResidualBlock(factors_.back().get(), &loss_, from, to);
      for (double* pose : {from, to}) ordering.AddElementToGroup(pose, 1);
    }
  }

 private:
  ceres::ScaledLoss loss_;
  std::vector<std::unique_ptr<RelativePoseFactor>> factors_;
};

int SolveRound(const BundleProblem& bundle, const Factors& factors, const Round& round,
               Parameters& parameters, InertialBundle& inertial) {
  ceres::Problem::Options ownership;
  ownership.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ownership.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem problem(ownership);
  ceres::HuberLoss loss(round.options.huber);
  ceres::Solver::Options solver;
  solver.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  AddVision(bundle, factors, round, loss, parameters, problem, *solver.linear_solver_ordering);
  inertial.AddTo(parameters.poses, round.visual_variance, 1, problem,
                 *solver.linear_solver_ordering);
  Loops loops(bundle, parameters.poses, round.visual_variance, problem,
              *solver.linear_solver_ordering);
  for (std::size_t i = 0; i < parameters.poses.size(); ++i) {
    double* pose = parameters.poses[i].data();
    if (!problem.HasParameterBlock(pose)) continue;
    problem.SetManifold(pose, new PoseManifold);
    if (bundle.pose_fixed[i]) problem.SetParameterBlockConstant(pose);
  }
  solver.linear_solver_type = round.options.sparse ? ceres::SPARSE_SCHUR : ceres::DENSE_SCHUR;
  solver.max_num_iterations = round.iterations;
  solver.function_tolerance = round.options.function_tolerance;
  solver.num_threads = 1;
  solver.logging_type = ceres::SILENT;
  IterationReporter reporter(round.options.on_iteration, round.first_iteration);
  solver.callbacks.push_back(&reporter);
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &problem, &summary);
  return static_cast<int>(summary.iterations.size());
}

// Squared residual of one observation, summed over its 2 to 4 coordinates.
double SquaredError(const ceres::CostFunction& factor, const double* pose, const double* landmark) {
  double residuals[4];
  const double* blocks[] = {pose, landmark};
  factor.Evaluate(blocks, residuals, nullptr);
  double squares = 0;
  for (int i = 0; i < factor.num_residuals(); ++i) squares += residuals[i] * residuals[i];
  return squares;
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

// The squares of residuals and how many there are.
struct Errors {
  double squares = 0;
  int coordinates = 0;

  double Rms() const { return coordinates > 0 ? std::sqrt(squares / coordinates) : 0; }
};

// Marks outliers (when max_error is not zero) and returns the errors of the others.
Errors JudgePoints(const BundleProblem& bundle, const Factors& factors, Parameters& parameters,
                   double max_error, std::vector<bool>& outlier) {
  Errors errors;
  for (std::size_t i = 0; i < factors.points.size(); ++i) {
    const BundleProblem::Observation& o = bundle.observations[i];
    const double error = SquaredError(*factors.points[i], parameters.poses[o.pose].data(),
                                      parameters.point(o.point));
    const int rows = factors.points[i]->num_residuals();
    if (max_error > 0) outlier[i] = error * 2 / rows > max_error * max_error;
    if (outlier[i]) continue;
    errors.squares += error;
    errors.coordinates += rows;
  }
  return errors;
}

Errors JudgeLines(const BundleProblem& bundle, const Factors& factors, Parameters& parameters,
                  double max_error, std::vector<bool>& outlier) {
  Errors errors;
  for (std::size_t i = 0; i < factors.lines.size(); ++i) {
    const BundleProblem::LineSeen& o = bundle.line_observations[i];
    const double error =
        SquaredError(*factors.lines[i], parameters.poses[o.pose].data(), parameters.line(o.line));
    const int rows = factors.lines[i]->num_residuals();
    if (max_error > 0) {
      outlier[i] = error * 2 / rows > max_error * max_error ||
                   !LiesInFront(bundle.stereo, FromParameter(parameters.poses[o.pose]),
                                parameters.LineInWorld(o.line), o.seen);
    }
    if (outlier[i]) continue;
    errors.squares += error;
    errors.coordinates += rows;
  }
  return errors;
}

// The variance of a pixel coordinate as the residuals show it, in squares of its assumed sigma:
// what the IMU is weighed against. At most 1.
double VisualVariance(const BundleProblem& bundle, const Errors& errors) {
  const auto unknowns =
      static_cast<double>(3 * bundle.points_in_world.size() + 6 * bundle.world_from_cam.size());
  const double freedom = std::max(errors.coordinates - unknowns, 0.1 * errors.coordinates);
  const double mean = errors.Rms() * errors.Rms();
  return errors.coordinates > 0 ? std::clamp(mean * errors.coordinates / freedom, 0.01, 1.0) : 1.0;
}

Factors MakeFactors(const BundleProblem& problem) {
  Factors factors;
  factors.points.reserve(problem.observations.size());
  for (const BundleProblem::Observation& o : problem.observations) {
    factors.points.push_back(std::make_unique<PointFactor>(problem.stereo, o.seen));
  }
  factors.lines.reserve(problem.line_observations.size());
  for (const BundleProblem::LineSeen& o : problem.line_observations) {
    factors.lines.push_back(std::make_unique<LineFactor>(problem.stereo, o.seen));
  }
  return factors;
}

void CopyTo(Parameters& parameters, BundleProblem& problem) {
  for (std::size_t i = 0; i < parameters.poses.size(); ++i) {
    if (!problem.pose_fixed[i]) problem.world_from_cam[i] = FromParameter(parameters.poses[i]);
  }
  for (std::size_t i = 0; i < problem.points_in_world.size(); ++i) {
    problem.points_in_world[i] =
        Eigen::Map<const Eigen::Vector3d>(parameters.point(static_cast<int>(i)));
  }
  for (std::size_t i = 0; i < problem.lines_in_world.size(); ++i) {
    problem.lines_in_world[i] = parameters.LineInWorld(static_cast<int>(i));
  }
}

}  // namespace

BundleSummary SolveBundle(const BundleOptions& options, BundleProblem* problem) {
  Parameters parameters(*problem);
  const Factors factors = MakeFactors(*problem);
  BundleSummary summary;
  summary.outlier.assign(factors.points.size(), false);
  summary.line_outlier.assign(factors.lines.size(), false);
  Errors errors = JudgePoints(*problem, factors, parameters, 0, summary.outlier);
  summary.initial_rms = errors.Rms();
  InertialBundle inertial(problem->inertial);
  int first_iteration = 0;
  for (const int iterations : {options.robust_iterations, options.final_iterations}) {
    const Round round{options, summary, iterations, first_iteration,
                      VisualVariance(*problem, errors)};
    first_iteration += iterations;
    summary.iterations += SolveRound(*problem, factors, round, parameters, inertial);
    errors = JudgePoints(*problem, factors, parameters, options.max_error, summary.outlier);
    summary.line_rms =
        JudgeLines(*problem, factors, parameters, options.max_error, summary.line_outlier).Rms();
  }
  summary.final_rms = errors.Rms();
  CopyTo(parameters, *problem);
  inertial.CopyTo(problem->inertial);
  return summary;
}

}  // namespace airslam
