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

// Residual (u, v, u_right) of one observation and what its derivatives are made of.
struct PointTerms {
  Eigen::Vector3d residual;
  Eigen::Matrix3d by_camera_point;
  CameraPoint camera_point;
};

PointTerms ComputeTerms(const StereoCamera& stereo, const PointObservation& seen,
                        const double* pose, const double* point_in_world) {
  PointTerms terms;
  terms.camera_point = ToCamera(pose, point_in_world);
  const Eigen::Vector3d& p = terms.camera_point.point;
  terms.by_camera_point.setZero();
  if (p.z() < kMinDepth) {
    terms.residual.setConstant(PointFactor::kBehindResidual);
    return terms;
  }
  const Pinhole& camera = stereo.camera;
  const double weight = 1.0 / seen.sigma;
  const double inverse_depth = 1.0 / p.z();
  const Eigen::Vector2d pixel = camera.Project(p);
  const double disparity = camera.fx * stereo.baseline * inverse_depth;
  terms.residual = weight * Eigen::Vector3d(pixel.x() - seen.pixel.x(), pixel.y() - seen.pixel.y(),
                                            pixel.x() - disparity - seen.right_x);
  Eigen::Matrix3d& by_p = terms.by_camera_point;
  by_p(0, 0) = weight * camera.fx * inverse_depth;
  by_p(0, 2) = -weight * (pixel.x() - camera.cx) * inverse_depth;
  by_p(1, 1) = weight * camera.fy * inverse_depth;
  by_p(1, 2) = -weight * (pixel.y() - camera.cy) * inverse_depth;
  by_p(2, 0) = by_p(0, 0);
  by_p(2, 2) = by_p(0, 2) + weight * disparity * inverse_depth;
  return terms;
}

// Rows of the derivatives by pose and by point, where Ceres wants them.
template <int kRows>
void FillJacobians(const Eigen::Matrix<double, kRows, 3>& by_camera_point, const CameraPoint& p,
                   double* by_pose, double* by_point) {
  if (by_pose != nullptr) {
    Eigen::Map<Eigen::Matrix<double, kRows, 7, Eigen::RowMajor>> rows(by_pose);
    rows.template leftCols<4>() = by_camera_point * p.by_quaternion;
    rows.template rightCols<3>() = -by_camera_point * p.by_point;
  }
  if (by_point != nullptr) {
    Eigen::Map<Eigen::Matrix<double, kRows, 3, Eigen::RowMajor>> rows(by_point);
    rows = by_camera_point * p.by_point;
  }
}

}  // namespace

bool PointFactor::Evaluate(double const* const* parameters, double* residuals,
                           double** jacobians) const {
  const PointTerms terms = ComputeTerms(stereo_, observation_, parameters[0], parameters[1]);
  Eigen::Vector2d::Map(residuals) = terms.residual.head<2>();
  if (jacobians != nullptr) {
    FillJacobians<2>(terms.by_camera_point.topRows<2>(), terms.camera_point, jacobians[0],
                     jacobians[1]);
  }
  return true;
}

bool RightPointFactor::Evaluate(double const* const* parameters, double* residuals,
                                double** jacobians) const {
  const PointTerms terms = ComputeTerms(stereo_, observation_, parameters[0], parameters[1]);
  residuals[0] = terms.residual[2];
  residuals[1] = 0;
  if (jacobians == nullptr) return true;
  Eigen::Matrix<double, 2, 3> by_camera_point = Eigen::Matrix<double, 2, 3>::Zero();
  by_camera_point.row(0) = terms.by_camera_point.row(2);
  FillJacobians<2>(by_camera_point, terms.camera_point, jacobians[0], jacobians[1]);
  return true;
}

FixedPointFactor::FixedPointFactor(const StereoCamera& stereo, const PointObservation& observation,
                                   const Eigen::Vector3d& point_in_world)
    : stereo_(stereo), observation_(observation), point_in_world_(point_in_world) {
  set_num_residuals(observation.has_right() ? 3 : 2);
  *mutable_parameter_block_sizes() = {7};
}

bool FixedPointFactor::Evaluate(double const* const* parameters, double* residuals,
                                double** jacobians) const {
  const PointTerms terms =
      ComputeTerms(stereo_, observation_, parameters[0], point_in_world_.data());
  const bool both = observation_.has_right();
  Eigen::VectorXd::Map(residuals, num_residuals()) = terms.residual.head(num_residuals());
  if (jacobians == nullptr) return true;
  if (both) {
    FillJacobians<3>(terms.by_camera_point, terms.camera_point, jacobians[0], nullptr);
  } else {
    FillJacobians<2>(terms.by_camera_point.topRows<2>(), terms.camera_point, jacobians[0], nullptr);
  }
  return true;
}

}  // namespace airslam
