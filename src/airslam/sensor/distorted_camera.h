// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>

#include "airslam/geometry/pinhole.h"

namespace airslam {

enum class Distortion {
  kNone,
  kRadialTangential,  // k1 k2 p1 p2 (Brown-Conrady; EuRoC "radial-tangential", Kalibr "radtan")
  kEquidistant,       // k1 k2 k3 k4 (Kannala-Brandt; Kalibr "equidistant")
};

// A pinhole camera with lens distortion, as calibrated ("raw").
struct DistortedCamera {
  Pinhole pinhole;
  Distortion model = Distortion::kNone;
  std::array<double, 4> coefficients = {0, 0, 0, 0};

  // point_in_cam -> raw pixel. The point must lie in front of the camera. Outside the invertible
  // part of the distortion (see MaxRadius) the polynomial folds back and the pixel is meaningless.
  Eigen::Vector2d Project(const Eigen::Vector3d& point_in_cam) const;

  // raw pixel -> point on the plane z = 1 (Newton iterations, to 1e-10). Returns false when the
  // pixel lies outside the invertible part of the distortion.
  bool Unproject(const Eigen::Vector2d& pixel, Eigen::Vector3d* point_on_plane) const;

  // The largest distance from the optical axis on the plane z = 1 up to which the distortion is
  // invertible: there the distorted radius stops growing. Infinity when it always grows; an
  // equidistant lens ends at 89 degrees at the latest.
  double MaxRadius() const;
};

}  // namespace airslam
