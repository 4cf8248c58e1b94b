// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/cost_function.h>

#include <optional>

#include "airslam/geometry/pinhole.h"
#include "airslam/geometry/plucker_line.h"
#include "airslam/optimize/line_manifold.h"

namespace airslam {

// A line seen by one keyframe: in the left image and, where it was matched, in the right one too.
struct LineObservation {
  ImageSegment left;                  // pixels of the rectified left image
  std::optional<ImageSegment> right;  // pixels of the rectified right image; other ends are fine
  double sigma = 1;                   // standard deviation of an end point across the line, pixels
};

// Line re-projection error (paper, section V-E, "Line Re-projection Error"), in units of sigma: the
// signed distances of the two observed end points from the projected line, of the left image and,
// for a stereo observation, then of the right one: 2 or 4 residuals. Parameters: PoseParameter of
// world_from_cam of the left camera (7), LineParameter of the line in the world (6). Derivatives
// are with respect to the plain coefficients; the blocks need a PoseManifold and a LineManifold.
// Derivation: docs/factors.md.
//
// A line without an image (through a camera's centre, or its image far beyond every field of view)
// has constant residuals of kNoImageResidual and no derivative, so that it counts as an outlier
// instead of stopping the solver. The endless line is projected: whether the observed stretch lies
// before the camera is not part of the error; ask SegmentSeenAt (plucker_line.h).
class LineFactor final : public ceres::CostFunction {
 public:
  static constexpr double kNoImageResidual = 100.0;

  LineFactor(const StereoCamera& stereo, const LineObservation& observation);

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  StereoCamera stereo_;
  LineObservation observation_;
};

// The same with a line that is known: one parameter block, the pose (7).
class FixedLineFactor final : public ceres::CostFunction {
 public:
  FixedLineFactor(const StereoCamera& stereo, const LineObservation& observation,
                  const PluckerLine& line_in_world);

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override;

 private:
  LineFactor factor_;
  LineParameter line_in_world_;
};

}  // namespace airslam
