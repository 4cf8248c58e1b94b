// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include <span>
#include <vector>

#include "airslam/geometry/pinhole.h"
#include "airslam/geometry/rigid3.h"

namespace airslam {

// A point of the map and where the camera saw it.
struct PointSighting {
  Eigen::Vector3d point_in_world = Eigen::Vector3d::Zero();
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
};

struct PnpRansacOptions {
  double max_error = 4;   // pixels: sightings nearer than this agree with a pose
  int iterations = 1000;  // at the most; fewer when the confidence is reached
  double confidence = 0.999;
  bool minimal = true;  // poses from 4 sightings (P3P), which outliers spoil less; else 5 (EPnP)

  // Throws Error that names the wrong field.
  void Validate() const;
};

struct PnpRansacResult {
  Rigid3 cam_from_world;
  std::vector<int> inliers;  // indices of the sightings, ascending; empty: no pose was found
};

// The pose on which most sightings agree. Needs at least 6 of them. Deterministic (the generator's
// seed is fixed) and safe to call from many threads.
PnpRansacResult EstimatePnpRansac(const Pinhole& camera, std::span<const PointSighting> sightings,
                                  const PnpRansacOptions& options);

}  // namespace airslam
