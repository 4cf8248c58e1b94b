// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "airslam/geometry/pinhole.h"
#include "airslam/geometry/plucker_line.h"
#include "airslam/optimize/pose_parameter.h"

namespace airslam {

// A line seen by one keyframe: in the left image and, where it was matched, in the right one too.
struct LineObservation {
  ImageSegment left;                  // pixels of the rectified left image
  std::optional<ImageSegment> right;  // pixels of the rectified right image; other ends are fine
  double sigma = 1;                   // standard deviation of an end point across the line, pixels

  int rows() const { return right ? 4 : 2; }
};

// Which pose sees which line of a bundle, by position in its lists.
struct LineSeen {
  int pose = -1;
  int line = -1;
  LineObservation seen;
};

// A line of the world, (n, v) up to scale, with its derivatives by LineManifold's tangent.
struct LineInWorld {
  Eigen::Vector3d n, v;
  Eigen::Matrix<double, 3, 4> n_by_line, v_by_line;

  LineInWorld() = default;
  explicit LineInWorld(const double* parameter);  // a LineParameter
};

// Line re-projection error (paper, section V-E, "Line Re-projection Error"), in units of sigma: the
// signed distances of the two observed end points from the projected line, of the left image and,
// for a stereo observation, then of the right one: 2 or 4 rows; those beyond are zero. Derivation:
// docs/factors/lines.md.
//
// A line without an image (through a camera's centre, or its image far beyond every field of view)
// has constant residuals of kNoImageResidual and no derivative, so that it counts as an outlier
// instead of stopping the solver. The endless line is projected: whether the observed stretch lies
// before the camera is not part of the error; ask SegmentSeenAt (plucker_line.h).
struct LineResidual {
  static constexpr double kNoImageResidual = 100.0;

  Eigen::Vector4d values;
  Eigen::Matrix<double, 4, 6> by_pose;  // tangent of PoseManifold of the left camera
  Eigen::Matrix4d by_line;              // tangent of LineManifold

  // Without `derivatives` by_pose and by_line are left unset.
  LineResidual(const StereoCamera& stereo, const LineObservation& seen, const CameraView& view,
               const LineInWorld& line, bool derivatives);
};

}  // namespace airslam
