// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "airslam/geometry/pinhole.h"
#include "airslam/optimize/pose_parameter.h"

namespace airslam {

// A point seen by one keyframe: in the left image and, where right_x >= 0, in the right image too.
struct PointObservation {
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();  // rectified left image
  double right_x = -1;                              // column in the rectified right image
  double sigma = 1;                                 // standard deviation in pixels

  bool has_right() const { return right_x >= 0; }
  int rows() const { return has_right() ? 3 : 2; }
};

// Which pose sees which point of a bundle, by position in its lists.
struct PointSeen {
  int pose = -1;
  int point = -1;
  PointObservation seen;
};

// Point re-projection error (paper, eq. 12; signs: projected minus observed), in units of sigma:
// (u, v, u_right); the last is zero where the point was not seen in the right image. Derivation:
// docs/factors/points.md.
//
// A point at or behind the camera has a constant residual of kBehindResidual and no derivative, so
// that it counts as an outlier instead of stopping the solver. In this header because the bundle
// adjustment spends its time here.
struct PointResidual {
  static constexpr double kBehindResidual = 100.0;
  static constexpr double kMinDepth = 1e-3;  // metres

  Eigen::Vector3d from_centre;      // point - centre, in world
  Eigen::Vector3d point_in_camera;  // metres
  Eigen::Vector3d values;

  PointResidual(const StereoCamera& stereo, const PointObservation& seen, const CameraView& view,
                const Eigen::Vector3d& point_in_world)
      : from_centre(point_in_world - view.centre),
        point_in_camera(view.cam_from_world * from_centre) {
    if (behind()) {
      values << kBehindResidual, kBehindResidual, seen.has_right() ? kBehindResidual : 0;
      return;
    }
    const Pinhole& camera = stereo.camera;
    const double weight = 1 / seen.sigma, inverse_depth = 1 / point_in_camera.z();
    const double u = camera.fx * point_in_camera.x() * inverse_depth + camera.cx;
    const double v = camera.fy * point_in_camera.y() * inverse_depth + camera.cy;
    const double disparity = camera.fx * stereo.baseline * inverse_depth;
    values << weight * (u - seen.pixel.x()), weight * (v - seen.pixel.y()),
        seen.has_right() ? weight * (u - disparity - seen.right_x) : 0;
  }

  bool behind() const { return point_in_camera.z() < kMinDepth; }

  // Derivatives of the values by the point in world: zero behind the camera, and in the third row
  // where there is no right image. Those by a shift of the camera are the negative, those by
  // PoseManifold's turn are 2 ByPoint() [from_centre]x.
  Eigen::Matrix3d ByPoint(const StereoCamera& stereo, const PointObservation& seen,
                          const CameraView& view) const {
    Eigen::Matrix3d by_camera_point = Eigen::Matrix3d::Zero();
    if (behind()) return by_camera_point;
    const Pinhole& camera = stereo.camera;
    const double weight = 1 / seen.sigma, inverse_depth = 1 / point_in_camera.z();
    const double x = point_in_camera.x() * inverse_depth, y = point_in_camera.y() * inverse_depth;
    const double along_x = weight * camera.fx * inverse_depth;
    const double along_y = weight * camera.fy * inverse_depth;
    by_camera_point(0, 0) = along_x;
    by_camera_point(0, 2) = -along_x * x;
    by_camera_point(1, 1) = along_y;
    by_camera_point(1, 2) = -along_y * y;
    if (seen.has_right()) {
      by_camera_point(2, 0) = along_x;
      by_camera_point(2, 2) = along_x * (stereo.baseline * inverse_depth - x);
    }
    return by_camera_point * view.cam_from_world;
  }
};

}  // namespace airslam
