// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/line_factor.h"

#include <algorithm>

namespace airslam {

LineFactor::LineFactor(const StereoCamera& stereo, const LineObservation& observation)
    : stereo_(stereo), observation_(observation) {
  set_num_residuals(observation.rows());
  *mutable_parameter_block_sizes() = {7, 6};
}

bool LineFactor::Evaluate(double const* const* parameters, double* residuals,
                          double** jacobians) const {
  const int rows = num_residuals();
  const LineResidual residual(stereo_, observation_, CameraView(parameters[0]),
                              LineInWorld(parameters[1]), jacobians != nullptr);
  std::copy_n(residual.values.data(), rows, residuals);
  if (jacobians == nullptr) return true;
  if (jacobians[0] != nullptr) {
    WriteByPoseParameter(residual.by_pose.topRows(rows), parameters[0], jacobians[0]);
  }
  if (jacobians[1] != nullptr) {
    Eigen::Matrix<double, 4, 6, Eigen::RowMajor> tangent_by_parameter;
    LineManifold().MinusJacobian(parameters[1], tangent_by_parameter.data());
    Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, 6, Eigen::RowMajor>>(jacobians[1], rows, 6) =
        residual.by_line.topRows(rows).lazyProduct(tangent_by_parameter);
  }
  return true;
}

}  // namespace airslam
