// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>

#include "airslam/geometry/rigid3.h"

namespace airslam {

// One sighting of a point.
struct RayObservation {
  Rigid3 cam_from_world;
  Eigen::Vector3d ray;  // towards the point, camera frame; any length, z > 0
};

struct TriangulationOptions {
  double min_depth = 0.05;      // m, z in every camera
  double max_depth = 1000.0;    // m, z in every camera
  double min_parallax = 0.017;  // rad, the largest angle between two of the rays
  // Largest distance of any ray from the projected point on the plane z = 1 (pixels / focal
  // length).
  double max_error = 0.01;
  int refinements = 5;  // Gauss-Newton steps, a fixed number
};

// The point (world frame) that the rays see: first the point of least squared distance to the rays
// (linear), then Gauss-Newton on the squared distances on the plane z = 1 of each camera.
//
// Returns nothing with fewer than two rays, with too little parallax, when the point lies behind a
// camera or outside the depth range, or when a ray misses it by more than max_error.
std::optional<Eigen::Vector3d> TriangulatePoint(std::span<const RayObservation> observations,
                                                const TriangulationOptions& options = {});

// The largest angle in radians between any two of the rays, seen in the world frame.
double LargestParallax(std::span<const RayObservation> observations);

}  // namespace airslam
