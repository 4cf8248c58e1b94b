// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "airslam/geometry/pinhole.h"
#include "airslam/geometry/rigid3.h"
#include "airslam/optimize/point_residual.h"
#include "airslam/optimize/pose_prior_factor.h"

namespace airslam {

struct PoseOptimizationOptions {
  int rounds = 3;                // each ends with a rejection of outliers
  int iterations_per_round = 6;  // Levenberg-Marquardt
  double huber = 1.5;            // in sigmas; all rounds but the last
  double max_error = 3.5;        // in sigmas, of the pixel distance: beyond it an outlier
};

// A known point and where it was seen.
struct PointConstraint {
  Eigen::Vector3d point_in_world = Eigen::Vector3d::Zero();
  PointObservation observation;
};

struct PoseOptimizationResult {
  Rigid3 world_from_cam;
  std::vector<bool> inlier;  // one a constraint
  int inliers = 0;
  double rms = 0;  // of the inliers' pixel distances, in sigmas
};

// Inverse covariance of a pose as the points alone give it, in the order of PosePrior's errors.
// Each constraint counts with its own sigma; points behind the camera do not count.
Matrix6d PoseInformation(const StereoCamera& stereo,
                         const std::vector<PointConstraint>& constraints,
                         const Rigid3& world_from_cam);

// Motion-only optimization with outlier rejection (paper, section V-A), and with a prior if there
// is one. Needs at least 4 constraints; with fewer the start is returned with no inlier.
// Deterministic.
PoseOptimizationResult OptimizePose(const StereoCamera& stereo,
                                    const std::vector<PointConstraint>& constraints,
                                    const Rigid3& initial_world_from_cam,
                                    const std::optional<PosePrior>& prior,
                                    const PoseOptimizationOptions& options);

}  // namespace airslam
