// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/calibrate/epipolar.h"

#include <Eigen/Geometry>
#include <cmath>

#include "airslam/geometry/so3.h"

namespace airslam {
namespace {

constexpr double kVelocityStep = 1e-3;  // s

Eigen::Vector3d Radial(const Eigen::Vector3d& ray, const std::array<double, 3>& a) {
  const double s = ray.head<2>().squaredNorm();
  const double scale = 1 + s * (a[0] + s * (a[1] + s * a[2]));
  return {scale * ray.x(), scale * ray.y(), 1};
}

}  // namespace

double& RigCorrection::at(int parameter) {
  if (parameter < 3) return turn[parameter];
  if (parameter < 5) return direction[parameter - 3];
  if (parameter < 8) return left_radial[static_cast<std::size_t>(parameter - 5)];
  if (parameter < 11) return right_radial[static_cast<std::size_t>(parameter - 8)];
  return delay;
}

std::vector<RayMatch> ToRays(const StereoRig& rig, std::span<const RawMatch> matches) {
  std::vector<RayMatch> rays;
  rays.reserve(matches.size());
  for (const RawMatch& match : matches) {
    RayMatch& ray = rays.emplace_back();
    ray.valid = rig.left.camera.Unproject(match.left, &ray.left) &&
                rig.right.camera.Unproject(match.right, &ray.right);
    Eigen::Vector3d moved;
    if (!ray.valid || !match.has_velocity) continue;
    ray.has_velocity =
        rig.right.camera.Unproject(match.right + kVelocityStep * match.velocity, &moved);
    if (ray.has_velocity) ray.right_per_second = (moved - ray.right) / kVelocityStep;
  }
  return rays;
}

EpipolarGeometry::EpipolarGeometry(const StereoRig& rig, const RigCorrection& correction)
    : correction_(correction), turn_(ExpSO3(correction.turn).toRotationMatrix()) {
  const Rigid3 right_from_left = rig.right.body_from_cam.Inverse() * rig.left.body_from_cam;
  right_from_left_ = right_from_left.rotation.toRotationMatrix();
  const Eigen::Vector3d direction = right_from_left.translation.normalized();
  // About y and z for a baseline along x.
  const Eigen::Vector3d second =
      Eigen::Vector3d::UnitZ().cross(direction).norm() > 0.5
          ? Eigen::Vector3d(Eigen::Vector3d::UnitZ().cross(direction).normalized())
          : Eigen::Vector3d(direction.unitOrthogonal());
  const Eigen::Vector3d third = direction.cross(second);
  baseline_ =
      ExpSO3(correction.direction[0] * second + correction.direction[1] * third) * direction;
  const Pinhole &left = rig.left.camera.pinhole, &right = rig.right.camera.pinhole;
  focal_ = 0.25 * (left.fx + left.fy + right.fx + right.fy);
}

EpipolarError EpipolarGeometry::Error(const RayMatch& match) const {
  const Eigen::Vector3d left = Radial(match.left, correction_.left_radial);
  Eigen::Vector3d right = match.right;
  if (correction_.delay != 0) right -= correction_.delay * match.right_per_second;
  right = turn_ * Radial(right, correction_.right_radial);
  right /= right.z();

  const Eigen::Vector3d turned = right_from_left_ * left;
  const Eigen::Vector3d line_in_right = baseline_.cross(turned);  // E l
  const Eigen::Vector3d line_in_left = right_from_left_.transpose() * right.cross(baseline_);
  const double gradient = std::sqrt(
      0.5 * (line_in_left.head<2>().squaredNorm() + line_in_right.head<2>().squaredNorm()));
  EpipolarError error;
  error.pixels = focal_ * right.dot(line_in_right) / std::max(gradient, 1e-9);

  // depth_right * right = depth_left * turned + baseline.
  const Eigen::Vector3d across = right.cross(turned);
  const double depth_left = -across.dot(right.cross(baseline_));
  const double depth_right = -across.dot(turned.cross(baseline_));
  const double angle = across.norm() / (right.norm() * turned.norm());
  error.parallax = focal_ * (depth_left > 0 && depth_right > 0 ? angle : -angle);
  return error;
}

}  // namespace airslam
