// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

namespace airslam {

// An undistorted (rectified) pinhole camera. Frame: x right, y down, z forward. Integer pixel
// coordinates are pixel centres. Lengths in pixels.
struct Pinhole {
  double fx = 0, fy = 0, cx = 0, cy = 0;
  int width = 0, height = 0;

  // point_in_cam with z > 0 -> pixel.
  Eigen::Vector2d Project(const Eigen::Vector3d& point_in_cam) const {
    return {fx * point_in_cam.x() / point_in_cam.z() + cx,
            fy * point_in_cam.y() / point_in_cam.z() + cy};
  }

  // pixel -> point on the plane z = 1.
  Eigen::Vector3d Unproject(const Eigen::Vector2d& pixel) const {
    return {(pixel.x() - cx) / fx, (pixel.y() - cy) / fy, 1.0};
  }

  // True when the pixel lies at least `border` pixels inside the image.
  bool Contains(const Eigen::Vector2d& pixel, double border = 0) const {
    return pixel.x() >= border && pixel.y() >= border && pixel.x() <= width - 1 - border &&
           pixel.y() <= height - 1 - border;
  }
};

// A rectified stereo pair: both images share one pinhole camera, rows correspond, and the right
// camera stands `baseline` metres along +x of the left one.
// disparity = u_left - u_right = fx * baseline / depth.
struct StereoCamera {
  Pinhole camera;
  double baseline = 0;

  double Disparity(double depth) const { return camera.fx * baseline / depth; }
  double Depth(double disparity) const { return camera.fx * baseline / disparity; }
};

}  // namespace airslam
