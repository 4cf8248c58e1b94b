// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/line_residual.h"

#include "airslam/geometry/so3.h"

namespace airslam {
namespace {

using Matrix23 = Eigen::Matrix<double, 2, 3>;
constexpr double kMinCentreDistance = 1e-3;  // metres between the line and the camera's centre
constexpr double kMinSlope = 1e-4;           // of the plane through line and centre

// Signed distances of both end points from the image of a line with the moment n about the camera's
// centre and the direction v, times `weight`, and their derivative by n. False when the line has no
// image.
bool EndDistances(const Pinhole& camera, const Eigen::Vector3d& n, const Eigen::Vector3d& v,
                  const ImageSegment& segment, double weight, double* distances, Matrix23* by_n) {
  const double slope = n.head<2>().norm();
  if (!(n.norm() > kMinCentreDistance * v.norm() && slope > kMinSlope * n.norm())) return false;
  const Eigen::Matrix3d projection = LineProjection(camera);
  const Eigen::Vector3d image_line = projection * n;
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

}  // namespace

LineInWorld::LineInWorld(const double* parameter) {
  const Eigen::Matrix3d u = Eigen::Map<const Eigen::Quaterniond>(parameter).toRotationMatrix();
  const double w1 = parameter[4], w2 = parameter[5];
  n = w1 * u.col(0);
  v = w2 * u.col(1);
  // U <- U Exp(a, b, c) changes u1 by c u2 - b u3 and u2 by a u3 - c u1; d changes w by (-w2, w1).
  n_by_line << Eigen::Vector3d::Zero(), -w1 * u.col(2), w1 * u.col(1), -w2 * u.col(0);
  v_by_line << w2 * u.col(2), Eigen::Vector3d::Zero(), -w2 * u.col(0), w1 * u.col(1);
}

LineResidual::LineResidual(const StereoCamera& stereo, const LineObservation& seen,
                           const CameraView& view, const LineInWorld& line, bool derivatives)
    : values(Eigen::Vector4d::Zero()) {
  if (derivatives) by_pose.setZero(), by_line.setZero();
  // About the camera's centre, with the world's axes and with the camera's.
  const Eigen::Vector3d moment = line.n - view.centre.cross(line.v);
  const Eigen::Vector3d n_in_cam = view.cam_from_world * moment;
  const Eigen::Vector3d v_in_cam = view.cam_from_world * line.v;
  const Eigen::Vector3d right_centre(stereo.baseline, 0, 0);
  const double weight = 1 / seen.sigma;
  Eigen::Matrix3d moment_by_turn, turned_v, n_by_shift;
  Eigen::Matrix<double, 3, 4> moment_by_line;
  if (derivatives) {
    turned_v = 2 * Skew(line.v);  // R^T v by PoseManifold's turn is R^T turned_v
    moment_by_turn = 2 * Skew(moment);
    moment_by_line = line.n_by_line - Skew(view.centre) * line.v_by_line;
  }
  for (int side = 0; side < (seen.right ? 2 : 1); ++side) {
    Matrix23 by_n;
    const bool is_right = side == 1;
    const Eigen::Vector3d n =
        is_right ? Eigen::Vector3d(n_in_cam - right_centre.cross(v_in_cam)) : n_in_cam;
    if (!EndDistances(stereo.camera, n, v_in_cam, is_right ? *seen.right : seen.left, weight,
                      values.data() + 2 * side, &by_n)) {
      values.setZero();
      values.head(seen.rows()).setConstant(kNoImageResidual);
      if (derivatives) by_pose.setZero(), by_line.setZero();
      return;
    }
    if (!derivatives) continue;
    const Matrix23 by_moment = by_n * view.cam_from_world;
    auto pose_rows = by_pose.middleRows<2>(2 * side);
    auto line_rows = by_line.middleRows<2>(2 * side);
    pose_rows << by_moment * moment_by_turn, 0.5 * by_moment * turned_v;
    line_rows = by_moment * moment_by_line;
    if (!is_right) continue;
    const Matrix23 by_v = -by_n * Skew(right_centre) * view.cam_from_world;
    pose_rows.leftCols<3>() += by_v * turned_v;
    line_rows += by_v * line.v_by_line;
  }
}

}  // namespace airslam
