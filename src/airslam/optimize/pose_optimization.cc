// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/pose_optimization.h"

#include <Eigen/Cholesky>
#include <cmath>

#include "airslam/geometry/so3.h"
#include "airslam/optimize/damping.h"
#include "airslam/optimize/huber.h"
#include "airslam/optimize/point_residual.h"
#include "airslam/optimize/pose_parameter.h"

namespace airslam {
namespace {

constexpr int kMinConstraints = 4;

using Vector6d = Eigen::Matrix<double, 6, 1>;

// Levenberg-Marquardt for six unknowns, by the rules of the bundle adjustment's solver
// (docs/factors.md). Every frame asks for it two or three times.
class PoseSolver {
 public:
  PoseSolver(const StereoCamera& stereo, const std::vector<PointConstraint>& constraints,
             const std::optional<PosePrior>& prior)
      : stereo_(stereo), constraints_(constraints) {
    if (prior) prior_.emplace(*prior);
  }

  // Moves `pose` by those of the constraints that are `used`, and by the prior.
  void Solve(const std::vector<bool>& used, const Huber& loss, int iterations,
             PoseParameter& pose) const;

  // Root of the mean squared residual per image axis pair, so that a stereo observation is judged
  // by the same bound as one of the left image only.
  double PixelError(const PointConstraint& constraint, const CameraView& view) const {
    return std::sqrt(Residual(constraint, view).values.squaredNorm() * 2 /
                     constraint.observation.rows());
  }

 private:
  // H x = b by PoseManifold's tangent.
  struct Equations {
    Matrix6d information = Matrix6d::Zero();
    Vector6d gradient = Vector6d::Zero();
  };

  PointResidual Residual(const PointConstraint& c, const CameraView& view) const {
    return {stereo_, c.observation, view, c.point_in_world};
  }
  double Cost(const std::vector<bool>& used, const Huber& loss, const PoseParameter& pose) const;
  Equations Linearize(const std::vector<bool>& used, const Huber& loss,
                      const PoseParameter& pose) const;
  void AddPrior(const PoseParameter& pose, Equations& equations) const;

  const StereoCamera& stereo_;
  const std::vector<PointConstraint>& constraints_;
  std::optional<PosePriorFactor> prior_;
  PoseManifold manifold_;
};

double PoseSolver::Cost(const std::vector<bool>& used, const Huber& loss,
                        const PoseParameter& pose) const {
  const CameraView view(pose.data());
  double sum = 0;
  for (std::size_t i = 0; i < constraints_.size(); ++i) {
    if (used[i]) sum += loss.Cost(Residual(constraints_[i], view).values.squaredNorm());
  }
  if (prior_) {
    Vector6d residuals;
    const double* blocks[] = {pose.data()};
    prior_->Evaluate(blocks, residuals.data(), nullptr);
    sum += residuals.squaredNorm();
  }
  return 0.5 * sum;
}

PoseSolver::Equations PoseSolver::Linearize(const std::vector<bool>& used, const Huber& loss,
                                            const PoseParameter& pose) const {
  const CameraView view(pose.data());
  Equations equations;
  for (std::size_t i = 0; i < constraints_.size(); ++i) {
    if (!used[i]) continue;
    const PointConstraint& c = constraints_[i];
    const PointResidual residual = Residual(c, view);
    const double weight = loss.Weight(residual.values.squaredNorm());
    const Eigen::Matrix3d by_point = residual.ByPoint(stereo_, c.observation, view);
    Eigen::Matrix<double, 3, 6> by_pose;
    by_pose << by_point.lazyProduct(Skew(2 * residual.from_centre)), -by_point;
    equations.information += weight * by_pose.transpose().lazyProduct(by_pose);
    equations.gradient -= weight * by_pose.transpose().lazyProduct(residual.values);
  }
  if (prior_) AddPrior(pose, equations);
  return equations;
}

void PoseSolver::AddPrior(const PoseParameter& pose, Equations& equations) const {
  Vector6d residuals;
  Eigen::Matrix<double, 6, 7, Eigen::RowMajor> by_parameter;
  Eigen::Matrix<double, 7, 6, Eigen::RowMajor> parameter_by_step;
  const double* blocks[] = {pose.data()};
  double* jacobians[] = {by_parameter.data()};
  prior_->Evaluate(blocks, residuals.data(), jacobians);
  manifold_.PlusJacobian(pose.data(), parameter_by_step.data());
  const Matrix6d by_step = by_parameter * parameter_by_step;
  equations.information += by_step.transpose() * by_step;
  equations.gradient -= by_step.transpose() * residuals;
}

void PoseSolver::Solve(const std::vector<bool>& used, const Huber& loss, int iterations,
                       PoseParameter& pose) const {
  constexpr double kTolerance = 1e-6;  // of the cost: a step that changes it by less is the last
  Damping damping;
  double cost = Cost(used, loss, pose);
  for (int i = 0; i < iterations; ++i) {
    const Equations equations = Linearize(used, loss, pose);
    const Vector6d damped = damping.Of(equations.information.diagonal());
    const Matrix6d sum = equations.information + Matrix6d(damped.asDiagonal());
    const Vector6d step = sum.llt().solve(equations.gradient);
    const double expected = Damping::Decrease<Vector6d>(step, equations.gradient, damped);
    if (!(expected > 0)) return;  // nothing is left to gain, or the numbers are none
    PoseParameter next;
    manifold_.Plus(pose.data(), step.data(), next.data());
    const double change = cost - Cost(used, loss, next);
    if (damping.Judge(change / expected)) {
      pose = next;
      cost -= change;
    }
    if (std::abs(change) <= kTolerance * cost) return;
  }
}

}  // namespace

Matrix6d PoseInformation(const StereoCamera& stereo,
                         const std::vector<PointConstraint>& constraints,
                         const Rigid3& world_from_cam) {
  const Pinhole& camera = stereo.camera;
  const Rigid3 cam_from_world = world_from_cam.Inverse();
  Eigen::Matrix<double, 3, 6> point_by_pose;
  point_by_pose.rightCols<3>() = -cam_from_world.rotation.toRotationMatrix();
  Matrix6d information = Matrix6d::Zero();
  for (const PointConstraint& c : constraints) {
    const Eigen::Vector3d p = cam_from_world * c.point_in_world;
    if (p.z() <= 0) continue;
    point_by_pose.leftCols<3>() = Skew(p);
    const double x = camera.fx / p.z(), y = camera.fy / p.z();
    Eigen::Matrix3d pixel_by_point;
    pixel_by_point << x, 0, -x * p.x() / p.z(), 0, y, -y * p.y() / p.z(), x, 0,
        -x * (p.x() - stereo.baseline) / p.z();
    if (!c.observation.has_right()) pixel_by_point.row(2).setZero();
    const Eigen::Matrix<double, 3, 6> by_pose =
        pixel_by_point * point_by_pose / c.observation.sigma;
    information += by_pose.transpose() * by_pose;
  }
  return information;
}

PoseOptimizationResult OptimizePose(const StereoCamera& stereo,
                                    const std::vector<PointConstraint>& constraints,
                                    const Rigid3& initial_world_from_cam,
                                    const std::optional<PosePrior>& prior,
                                    const PoseOptimizationOptions& options) {
  PoseOptimizationResult result;
  result.world_from_cam = initial_world_from_cam;
  result.inlier.assign(constraints.size(), false);
  if (constraints.size() < kMinConstraints) return result;

  const PoseSolver solver(stereo, constraints, prior);
  result.inlier.assign(constraints.size(), true);
  result.inliers = static_cast<int>(constraints.size());
  PoseParameter pose = ToParameter(initial_world_from_cam);
  double squares = 0;
  for (int round = 0; round < options.rounds && result.inliers >= kMinConstraints; ++round) {
    const Huber loss = round + 1 < options.rounds ? Huber{options.huber} : Huber{};
    solver.Solve(result.inlier, loss, options.iterations_per_round, pose);
    result.inliers = 0;
    squares = 0;
    const CameraView view(pose.data());
    for (std::size_t i = 0; i < constraints.size(); ++i) {
      const double error = solver.PixelError(constraints[i], view);
      result.inlier[i] = error <= options.max_error;
      if (!result.inlier[i]) continue;
      ++result.inliers;
      squares += error * error;
    }
  }
  result.world_from_cam = FromParameter(pose);
  result.rms = result.inliers > 0 ? std::sqrt(squares / result.inliers) : 0;
  return result;
}

}  // namespace airslam
