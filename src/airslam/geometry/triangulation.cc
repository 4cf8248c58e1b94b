// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/geometry/triangulation.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <vector>

namespace airslam {
namespace {

// The point of least squared distance to the lines along the rays.
Eigen::Vector3d ClosestToRays(std::span<const RayObservation> observations) {
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  for (const RayObservation& seen : observations) {
    const Rigid3 world_from_cam = seen.cam_from_world.Inverse();
    const Eigen::Vector3d direction = world_from_cam.rotation * seen.ray.normalized();
    const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - direction * direction.transpose();
    normal += across;
    right += across * world_from_cam.translation;
  }
  return normal.ldlt().solve(right);
}

// Distance from the projected point to the ray on the plane z = 1; false when the point lies behind
// the camera.
bool PlaneError(const RayObservation& seen, const Eigen::Vector3d& point_in_world,
                Eigen::Vector3d* point_in_cam, Eigen::Vector2d* error) {
  *point_in_cam = seen.cam_from_world * point_in_world;
  if (point_in_cam->z() <= 0 || seen.ray.z() <= 0) return false;
  *error = point_in_cam->hnormalized() - seen.ray.hnormalized();
  return true;
}

// One Gauss-Newton step. Returns false when the point lies behind a camera.
bool Refine(std::span<const RayObservation> observations, Eigen::Vector3d* point_in_world) {
  Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();
  Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
  for (const RayObservation& seen : observations) {
    Eigen::Vector3d p;
    Eigen::Vector2d error;
    if (!PlaneError(seen, *point_in_world, &p, &error)) return false;
    Eigen::Matrix<double, 2, 3> projection;
    projection << 1 / p.z(), 0, -p.x() / (p.z() * p.z()), 0, 1 / p.z(), -p.y() / (p.z() * p.z());
    const Eigen::Matrix<double, 2, 3> jacobian =
        projection * seen.cam_from_world.rotation.toRotationMatrix();
    hessian += jacobian.transpose() * jacobian;
    gradient += jacobian.transpose() * error;
  }
  const Eigen::Vector3d step = hessian.ldlt().solve(gradient);
  if (!step.allFinite()) return false;
  *point_in_world -= step;
  return true;
}

}  // namespace

double LargestParallax(std::span<const RayObservation> observations) {
  std::vector<Eigen::Vector3d> directions;
  for (const RayObservation& seen : observations) {
    directions.push_back(seen.cam_from_world.rotation.conjugate() * seen.ray.normalized());
  }
  double largest = 0;
  for (std::size_t i = 0; i < directions.size(); ++i) {
    for (std::size_t j = i + 1; j < directions.size(); ++j) {
      const double sine = directions[i].cross(directions[j]).norm();
      largest = std::max(largest, std::atan2(sine, directions[i].dot(directions[j])));
    }
  }
  return largest;
}

std::optional<Eigen::Vector3d> TriangulatePoint(std::span<const RayObservation> observations,
                                                const TriangulationOptions& options) {
  if (observations.size() < 2) return std::nullopt;
  if (LargestParallax(observations) < options.min_parallax) return std::nullopt;

  Eigen::Vector3d point_in_world = ClosestToRays(observations);
  if (!point_in_world.allFinite()) return std::nullopt;
  for (int i = 0; i < options.refinements; ++i) {
    if (!Refine(observations, &point_in_world)) return std::nullopt;
  }

  for (const RayObservation& seen : observations) {
    Eigen::Vector3d point_in_cam;
    Eigen::Vector2d error;
    if (!PlaneError(seen, point_in_world, &point_in_cam, &error)) return std::nullopt;
    const double depth = point_in_cam.z();
    if (depth < options.min_depth || depth > options.max_depth) return std::nullopt;
    if (!(error.norm() <= options.max_error)) return std::nullopt;
  }
  return point_in_world;
}

}  // namespace airslam
