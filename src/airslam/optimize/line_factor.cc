// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/line_factor.h"

#include <algorithm>
#include <cmath>

#include "airslam/geometry/so3.h"

namespace airslam {
namespace {

using Matrix23 = Eigen::Matrix<double, 2, 3>;
using Matrix34 = Eigen::Matrix<double, 3, 4>;
using Matrix36 = Eigen::Matrix<double, 3, 6>;
using Matrix37 = Eigen::Matrix<double, 3, 7>;
constexpr double kMinCentreDistance = 1e-3;  // metres between the line and the camera's centre
constexpr double kMinSlope = 1e-4;           // of the plane through line and centre

// R(q) a as a polynomial in the coefficients of q = (v, w): a + 2 w (v x a) + 2 v x (v x a).
Eigen::Vector3d Turn(const Eigen::Vector3d& v, double w, const Eigen::Vector3d& a) {
  const Eigen::Vector3d v_cross_a = v.cross(a);
  return a + 2 * w * v_cross_a + 2 * v.cross(v_cross_a);
}

// Its derivative by q, in the order x, y, z, w.
Matrix34 TurnByQuaternion(const Eigen::Vector3d& v, double w, const Eigen::Vector3d& a) {
  Matrix34 jacobian;
  jacobian.leftCols<3>() = -2 * w * Skew(a) + 2 * (v.dot(a) * Eigen::Matrix3d::Identity() +
                                                   v * a.transpose() - 2 * a * v.transpose());
  jacobian.col(3) = 2 * v.cross(a);
  return jacobian;
}

// R(q)^T as a polynomial likewise.
Eigen::Matrix3d TurnBack(const Eigen::Vector3d& v, double w) {
  const Eigen::Matrix3d skew = Skew(v);
  return Eigen::Matrix3d::Identity() - 2 * w * skew + 2 * skew * skew;
}

// Derivative of R(q)^T a by q: that of Turn with the vector part negative.
Matrix34 TurnBackByQuaternion(const Eigen::Vector3d& v, double w, const Eigen::Vector3d& a) {
  Matrix34 jacobian = TurnByQuaternion(-v, w, a);
  jacobian.leftCols<3>() *= -1;
  return jacobian;
}

// A line in a camera's frame up to scale, with its derivatives.
struct CameraLine {
  Eigen::Vector3d n, v;
  Matrix37 n_by_pose, v_by_pose;
  Matrix36 n_by_line, v_by_line;
};

// n_cam = R^T (n - t x v), v_cam = R^T v with (n, v) = (w1 u1, w2 u2) in the world. The derivatives
// are left unset where they are not wanted.
CameraLine ToCamera(const double* pose, const double* line, bool by_pose, bool by_line) {
  const Eigen::Map<const Eigen::Vector3d> pose_q(pose), line_q(line);
  const Eigen::Map<const Eigen::Vector3d> t(pose + 4);
  const double w1 = line[4], w2 = line[5];
  const Eigen::Vector3d u1 = Turn(line_q, line[3], Eigen::Vector3d::UnitX());
  const Eigen::Vector3d u2 = Turn(line_q, line[3], Eigen::Vector3d::UnitY());
  const Eigen::Vector3d v = w2 * u2;
  const Eigen::Vector3d moment = w1 * u1 - t.cross(v);  // about the camera's centre
  const Eigen::Matrix3d cam_from_world = TurnBack(pose_q, pose[3]);
  CameraLine result;
  result.n = cam_from_world * moment;
  result.v = cam_from_world * v;
  if (by_pose) {
    result.n_by_pose << TurnBackByQuaternion(pose_q, pose[3], moment), cam_from_world * Skew(v);
    result.v_by_pose << TurnBackByQuaternion(pose_q, pose[3], v), Eigen::Matrix3d::Zero();
  }
  if (by_line) {
    Matrix36 world_n, world_v;
    world_n << w1 * TurnByQuaternion(line_q, line[3], Eigen::Vector3d::UnitX()), u1,
        Eigen::Vector3d::Zero();
    world_v << w2 * TurnByQuaternion(line_q, line[3], Eigen::Vector3d::UnitY()),
        Eigen::Vector3d::Zero(), u2;
    result.n_by_line = cam_from_world * (world_n - Skew(t) * world_v);
    result.v_by_line = cam_from_world * world_v;
  }
  return result;
}

// The same line about the centre of the right camera: n - b x v with b = (baseline, 0, 0).
CameraLine ToRight(CameraLine line, double baseline, bool by_pose, bool by_line) {
  const Eigen::Matrix3d shift = Skew(Eigen::Vector3d(baseline, 0, 0));
  line.n -= shift * line.v;
  if (by_pose) line.n_by_pose -= shift * line.v_by_pose;
  if (by_line) line.n_by_line -= shift * line.v_by_line;
  return line;
}

// Signed distances of both end points from the projected line, times `weight`, and their derivative
// by n. False when the line has no image.
bool EndDistances(const Pinhole& camera, const CameraLine& line, const ImageSegment& segment,
                  double weight, double* distances, Matrix23* by_n) {
  const double slope = line.n.head<2>().norm();
  if (!(line.n.norm() > kMinCentreDistance * line.v.norm() && slope > kMinSlope * line.n.norm())) {
    return false;
  }
  const Eigen::Matrix3d projection = LineProjection(camera);
  const Eigen::Vector3d image_line = projection * line.n;
  const double scale = weight / image_line.head<2>().norm();
  const Eigen::Vector2d across = image_line.head<2>().normalized();
  const Eigen::Vector2d ends[] = {segment.start, segment.end};
  for (int k = 0; k < 2; ++k) {
    distances[k] = scale * image_line.dot(ends[k].homogeneous());
    // d / dl of (l . p) / |(l1, l2)|.
    Eigen::RowVector3d by_image_line = scale * ends[k].homogeneous().transpose();
    by_image_line.head<2>() -= distances[k] * scale / weight * across.transpose();
    by_n->row(k) = by_image_line * projection;
  }
  return true;
}

// Writes the derivatives of the two residuals of one view. Either target may be null.
void FillJacobians(const Matrix23& by_n, const CameraLine& line, double* by_pose, double* by_line) {
  if (by_pose != nullptr) {
    Eigen::Map<Eigen::Matrix<double, 2, 7, Eigen::RowMajor>> target(by_pose);
    target = by_n * line.n_by_pose;
  }
  if (by_line != nullptr) {
    Eigen::Map<Eigen::Matrix<double, 2, 6, Eigen::RowMajor>> target(by_line);
    target = by_n * line.n_by_line;
  }
}

}  // namespace

LineFactor::LineFactor(const StereoCamera& stereo, const LineObservation& observation)
    : stereo_(stereo), observation_(observation) {
  set_num_residuals(observation.right ? 4 : 2);
  *mutable_parameter_block_sizes() = {7, 6};
}

bool LineFactor::Evaluate(double const* const* parameters, double* residuals,
                          double** jacobians) const {
  double* by_pose = jacobians != nullptr ? jacobians[0] : nullptr;
  double* by_line = jacobians != nullptr ? jacobians[1] : nullptr;
  const double weight = 1 / observation_.sigma;
  const CameraLine left =
      ToCamera(parameters[0], parameters[1], by_pose != nullptr, by_line != nullptr);
  Matrix23 by_n;
  bool has_image = EndDistances(stereo_.camera, left, observation_.left, weight, residuals, &by_n);
  if (has_image) FillJacobians(by_n, left, by_pose, by_line);
  if (has_image && observation_.right) {
    const CameraLine right =
        ToRight(left, stereo_.baseline, by_pose != nullptr, by_line != nullptr);
    has_image =
        EndDistances(stereo_.camera, right, *observation_.right, weight, residuals + 2, &by_n);
    if (has_image) {
      FillJacobians(by_n, right, by_pose != nullptr ? by_pose + 2 * 7 : nullptr,
                    by_line != nullptr ? by_line + 2 * 6 : nullptr);
    }
  }
  if (has_image) return true;
  const int rows = num_residuals();
  std::fill(residuals, residuals + rows, kNoImageResidual);
  if (by_pose != nullptr) std::fill(by_pose, by_pose + 7 * rows, 0.0);
  if (by_line != nullptr) std::fill(by_line, by_line + 6 * rows, 0.0);
  return true;
}

FixedLineFactor::FixedLineFactor(const StereoCamera& stereo, const LineObservation& observation,
                                 const PluckerLine& line_in_world)
    : factor_(stereo, observation), line_in_world_(ToParameter(line_in_world)) {
  set_num_residuals(factor_.num_residuals());
  *mutable_parameter_block_sizes() = {7};
}

bool FixedLineFactor::Evaluate(double const* const* parameters, double* residuals,
                               double** jacobians) const {
  const double* blocks[] = {parameters[0], line_in_world_.data()};
  double* by_block[] = {jacobians != nullptr ? jacobians[0] : nullptr, nullptr};
  return factor_.Evaluate(blocks, residuals, jacobians != nullptr ? by_block : nullptr);
}

}  // namespace airslam
