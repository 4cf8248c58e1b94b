// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/point_factor.h"

#include <algorithm>

#include "airslam/geometry/so3.h"

namespace airslam {

PointFactor::PointFactor(const StereoCamera& stereo, const PointObservation& observation)
    : stereo_(stereo), observation_(observation) {
  set_num_residuals(observation.rows());
  *mutable_parameter_block_sizes() = {7, 3};
}

bool PointFactor::Evaluate(double const* const* parameters, double* residuals,
                           double** jacobians) const {
  const int rows = num_residuals();
  const CameraView view(parameters[0]);
  const PointResidual residual(stereo_, observation_, view,
                               Eigen::Map<const Eigen::Vector3d>(parameters[1]));
  std::copy_n(residual.values.data(), rows, residuals);
  if (jacobians == nullptr) return true;
  const Eigen::Matrix3d by_point = residual.ByPoint(stereo_, observation_, view);
  if (jacobians[0] != nullptr) {
    Eigen::Matrix<double, 3, 6> by_pose;
    by_pose << 2 * by_point * Skew(residual.from_centre), -by_point;
    WriteByPoseParameter(by_pose.topRows(rows), parameters[0], jacobians[0]);
  }
  if (jacobians[1] != nullptr) {
    Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor>>(jacobians[1], rows, 3) =
        by_point.topRows(rows);
  }
  return true;
}

}  // namespace airslam
