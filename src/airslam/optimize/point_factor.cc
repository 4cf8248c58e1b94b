// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/point_factor.h"

#include "airslam/geometry/so3.h"

namespace airslam {
namespace {

using RowMajor34 = Eigen::Matrix<double, 3, 4, Eigen::RowMajor>;
constexpr double kMinDepth = 1e-3;  // metres

// point_in_cam = R(q)^T d with d = point_in_world - t, as a polynomial in the coefficients of
// q = (v, w):  d - 2 w (v x d) + 2 v x (v x d).
struct CameraPoint {
  Eigen::Vector3d point;
  RowMajor34 by_quaternion;  // order x, y, z, w
  Eigen::Matrix3d by_point;  // = R^T; by translation it is the negative
};

CameraPoint ToCamera(const double* pose, const double* point_in_world) {
  const Eigen::Map<const Eigen::Vector3d> v(pose);
  const double w = pose[3];
  const Eigen::Vector3d d = Eigen::Map<const Eigen::Vector3d>(point_in_world) -
                            Eigen::Map<const Eigen::Vector3d>(pose + 4);
  const Eigen::Vector3d v_cross_d = v.cross(d);
  const Eigen::Matrix3d v_skew = Skew(v);
  CameraPoint result;
  result.point = d - 2 * w * v_cross_d + 2 * v.cross(v_cross_d);
  result.by_quaternion.leftCols<3>() =
      2 * w * Skew(d) +
      2 * (v.dot(d) * Eigen::Matrix3d::Identity() + v * d.transpose() - 2 * d * v.transpose());
  result.by_quaternion.col(3) = -2 * v_cross_d;
  result.by_point = Eigen::Matrix3d::Identity() - 2 * w * v_skew + 2 * v_skew * v_skew;
  return result;
}

template <int kRows>
void FillJacobians(const Eigen::Matrix<double, kRows, 3>& by_camera_point, const CameraPoint& p,
                   double** jacobians) {
  if (jacobians[0] != nullptr) {
    Eigen::Map<Eigen::Matrix<double, kRows, 7, Eigen::RowMajor>> by_pose(jacobians[0]);
    by_pose.template leftCols<4>() = by_camera_point * p.by_quaternion;
    by_pose.template rightCols<3>() = -by_camera_point * p.by_point;
  }
  if (jacobians[1] != nullptr) {
    Eigen::Map<Eigen::Matrix<double, kRows, 3, Eigen::RowMajor>> by_point(jacobians[1]);
    by_point = by_camera_point * p.by_point;
  }
}

}  // namespace

PointFactor::PointFactor(const StereoCamera& stereo, const PointObservation& observation)
    : stereo_(stereo), observation_(observation) {
  set_num_residuals(observation.has_right() ? 3 : 2);
  *mutable_parameter_block_sizes() = {7, 3};
}

bool PointFactor::Evaluate(double const* const* parameters, double* residuals,
                           double** jacobians) const {
  const int rows = num_residuals();
  const CameraPoint p = ToCamera(parameters[0], parameters[1]);
  if (p.point.z() < kMinDepth) {
    std::fill(residuals, residuals + rows, kBehindResidual);
    if (jacobians != nullptr) {
      if (jacobians[0] != nullptr) std::fill(jacobians[0], jacobians[0] + 7 * rows, 0.0);
      if (jacobians[1] != nullptr) std::fill(jacobians[1], jacobians[1] + 3 * rows, 0.0);
    }
    return true;
  }
  const Pinhole& camera = stereo_.camera;
  const double weight = 1.0 / observation_.sigma;
  const double inverse_depth = 1.0 / p.point.z();
  const Eigen::Vector2d pixel = camera.Project(p.point);
  residuals[0] = weight * (pixel.x() - observation_.pixel.x());
  residuals[1] = weight * (pixel.y() - observation_.pixel.y());
  const double disparity = camera.fx * stereo_.baseline * inverse_depth;
  if (rows == 3) residuals[2] = weight * (pixel.x() - disparity - observation_.right_x);
  if (jacobians == nullptr) return true;

  Eigen::Matrix3d by_camera_point = Eigen::Matrix3d::Zero();
  by_camera_point(0, 0) = weight * camera.fx * inverse_depth;
  by_camera_point(0, 2) = -weight * (pixel.x() - camera.cx) * inverse_depth;
  by_camera_point(1, 1) = weight * camera.fy * inverse_depth;
  by_camera_point(1, 2) = -weight * (pixel.y() - camera.cy) * inverse_depth;
  by_camera_point(2, 0) = by_camera_point(0, 0);
  by_camera_point(2, 2) = by_camera_point(0, 2) + weight * disparity * inverse_depth;
  if (rows == 3) {
    FillJacobians<3>(by_camera_point, p, jacobians);
  } else {
    FillJacobians<2>(by_camera_point.topRows<2>(), p, jacobians);
  }
  return true;
}

FixedPointFactor::FixedPointFactor(const StereoCamera& stereo, const PointObservation& observation,
                                   const Eigen::Vector3d& point_in_world)
    : factor_(stereo, observation), point_in_world_(point_in_world) {
  set_num_residuals(factor_.num_residuals());
  *mutable_parameter_block_sizes() = {7};
}

bool FixedPointFactor::Evaluate(double const* const* parameters, double* residuals,
                                double** jacobians) const {
  const double* blocks[] = {parameters[0], point_in_world_.data()};
  double* by_block[] = {jacobians != nullptr ? jacobians[0] : nullptr, nullptr};
  return factor_.Evaluate(blocks, residuals, jacobians != nullptr ? by_block : nullptr);
}

}  // namespace airslam
