// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/testing/synthetic_world.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

namespace airslam {
namespace {

constexpr double kNearest = 0.05;    // metres: closer points are not seen
constexpr double kOnSurface = 0.01;  // metres
constexpr int kSegmentSamples = 48;

// The sign of corner `bits` (0..7) of a box along each axis.
Eigen::Vector3d Corner(int bits) {
  return {bits & 1 ? 1.0 : -1.0, bits & 2 ? 1.0 : -1.0, bits & 4 ? 1.0 : -1.0};
}

// The pixel of a visible point, without noise.
std::optional<Eigen::Vector2d> SeenAt(const SyntheticWorld& world, const DistortedCamera& camera,
                                      const Rigid3& world_from_cam, const Rigid3& cam_from_world,
                                      const Eigen::Vector3d& point_in_world) {
  const Eigen::Vector3d point_in_cam = cam_from_world * point_in_world;
  if (point_in_cam.z() < kNearest) return std::nullopt;
  // Far outside the field of view the distortion polynomial folds back into the image.
  const double margin = 1.2;
  const Pinhole& pinhole = camera.pinhole;
  if (std::abs(point_in_cam.x() / point_in_cam.z()) * pinhole.fx > margin * pinhole.width ||
      std::abs(point_in_cam.y() / point_in_cam.z()) * pinhole.fy > margin * pinhole.height) {
    return std::nullopt;
  }
  const Eigen::Vector2d pixel = camera.Project(point_in_cam);
  if (!pinhole.Contains(pixel)) return std::nullopt;
  Eigen::Vector3d back;
  if (!camera.Unproject(pixel, &back) ||
      (back.head<2>() - point_in_cam.head<2>() / point_in_cam.z()).norm() > 1e-6) {
    return std::nullopt;
  }
  if (!world.Visible(world_from_cam.translation, point_in_world)) return std::nullopt;
  return pixel;
}

Eigen::Vector2d Noise(double sigma, std::mt19937& random) {
  if (sigma <= 0) return Eigen::Vector2d::Zero();
  const double x = Normal(random);
  return sigma * Eigen::Vector2d(x, Normal(random));
}

// [first, last] of the longest run of true, or first > last when there is none.
std::pair<int, int> LongestRun(const std::array<bool, kSegmentSamples + 1>& visible) {
  std::pair<int, int> best(0, -1);
  int start = 0;
  for (int i = 0; i <= kSegmentSamples; ++i) {
    if (!visible[i]) {
      start = i + 1;
    } else if (i - start > best.second - best.first) {
      best = {start, i};
    }
  }
  return best;
}

}  // namespace

double Uniform(std::mt19937& random, double low, double high) {
  return low + (high - low) * (static_cast<double>(random()) / 4294967296.0);
}

double Normal(std::mt19937& random) {
  const double radius = std::sqrt(-2.0 * std::log(1.0 - Uniform(random, 0, 1)));
  return radius * std::cos(2.0 * std::numbers::pi * Uniform(random, 0, 1));
}

Eigen::Vector3d WorldBox::DirectionToLocal(const Eigen::Vector3d& direction_in_world) const {
  const double c = std::cos(yaw), s = std::sin(yaw);
  return {c * direction_in_world.x() + s * direction_in_world.y(),
          -s * direction_in_world.x() + c * direction_in_world.y(), direction_in_world.z()};
}

Eigen::Vector3d WorldBox::ToLocal(const Eigen::Vector3d& point_in_world) const {
  return DirectionToLocal(point_in_world - centre);
}

Eigen::Vector3d WorldBox::ToWorld(const Eigen::Vector3d& point_in_box) const {
  const double c = std::cos(yaw), s = std::sin(yaw);
  return centre + Eigen::Vector3d(c * point_in_box.x() - s * point_in_box.y(),
                                  s * point_in_box.x() + c * point_in_box.y(), point_in_box.z());
}

std::optional<RayHit> CastBox(const WorldBox& box, bool inside,
                              const Eigen::Vector3d& origin_in_box,
                              const Eigen::Vector3d& direction_in_box) {
  double enter = -std::numeric_limits<double>::infinity();
  double leave = std::numeric_limits<double>::infinity();
  int enter_axis = 0, leave_axis = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const double origin = origin_in_box[axis], size = box.half_size[axis];
    const double direction = direction_in_box[axis];
    if (direction == 0) {
      if (std::abs(origin) > size) return std::nullopt;
      continue;
    }
    const double towards = direction > 0 ? size : -size;
    const double near = (-towards - origin) / direction, far = (towards - origin) / direction;
    if (near > enter) enter = near, enter_axis = axis;
    if (far < leave) leave = far, leave_axis = axis;
  }
  const double distance = inside ? leave : enter;
  const int axis = inside ? leave_axis : enter_axis;
  if (enter > leave || distance < 1e-9) return std::nullopt;
  RayHit hit;
  hit.distance = distance;
  const Eigen::Vector3d point = origin_in_box + distance * direction_in_box;
  hit.face = 2 * axis + (point[axis] > 0 ? 1 : 0);
  hit.u = point[axis == 0 ? 1 : 0];
  hit.v = point[axis == 2 ? 1 : 2];
  hit.cosine = std::abs(direction_in_box[axis]) / direction_in_box.norm();
  return hit;
}

SyntheticWorld::SyntheticWorld(const SyntheticWorldOptions& options) {
  std::mt19937 random(options.seed);
  boxes_.push_back({{0, 0, options.height / 2},
                    {options.length / 2, options.width / 2, options.height / 2},
                    0,
                    options.seed * 1000u});
  AddShelves(options, random);
  AddCrates(random);
  AddBeams(options, random);
  AddPointsAndSegments(options.num_points, random);
}

void SyntheticWorld::AddBox(const Eigen::Vector3d& centre, const Eigen::Vector3d& size,
                            double yaw) {
  const auto running = static_cast<std::uint32_t>(boxes_.size());
  boxes_.push_back({centre, size / 2, yaw, boxes_.front().texture + running});
}

void SyntheticWorld::AddShelves(const SyntheticWorldOptions& options, std::mt19937& random) {
  for (const double side : {-1.0, 1.0}) {
    for (int slot = 0; slot < 5; ++slot) {  // along the long walls
      const double along = options.length * ((slot + 0.5) / 5 - 0.5) + Uniform(random, -0.3, 0.3);
      const double height = Uniform(random, 0.8, 3.0), depth = Uniform(random, 0.4, 0.9);
      const double across = side * (options.width / 2 - 0.2 - depth / 2);
      const double length = Uniform(random, 0.9, 2.2);
      AddBox({along, across, height / 2}, {length, depth, height}, Uniform(random, -0.1, 0.1));
    }
    for (int slot = 0; slot < 3; ++slot) {  // along the short walls
      const double along = (slot - 1) * 2.6 + Uniform(random, -0.3, 0.3);
      const double height = Uniform(random, 0.8, 3.0), depth = Uniform(random, 0.3, 0.7);
      const double across = side * (options.length / 2 - 0.2 - depth / 2);
      const double length = Uniform(random, 0.8, 1.8);
      AddBox({across, along, height / 2}, {depth, length, height}, Uniform(random, -0.1, 0.1));
    }
  }
}

void SyntheticWorld::AddCrates(std::mt19937& random) {
  for (int i = 0; i < 3; ++i) {
    const double angle = 2 * std::numbers::pi * (i + Uniform(random, 0, 0.5)) / 3;
    const double height = Uniform(random, 0.6, 2.2);
    const double length = Uniform(random, 0.5, 0.9), depth = Uniform(random, 0.5, 0.9);
    AddBox({0.7 * std::cos(angle), 0.7 * std::sin(angle), height / 2}, {length, depth, height},
           Uniform(random, -0.8, 0.8));
  }
  for (const auto& [x, y] : {std::pair(4.9, 2.4), {-4.9, 2.4}, {-4.7, 0.4}}) {
    const double height = Uniform(random, 0.5, 1.8), length = Uniform(random, 0.6, 1.2);
    const double depth = Uniform(random, 0.6, 1.2);
    AddBox({x, y, height / 2}, {length, depth, height}, Uniform(random, -0.8, 0.8));
  }
}

void SyntheticWorld::AddBeams(const SyntheticWorldOptions& options, std::mt19937& random) {
  for (int i = 0; i < 4; ++i) {
    const double x = options.length * ((i + 0.5) / 4 - 0.5) + Uniform(random, -0.4, 0.4);
    AddBox({x, 0, options.height - 0.4}, {0.25, 0.9 * options.width, 0.3}, 0);
  }
}

void SyntheticWorld::AddPointsAndSegments(int num_points, std::mt19937& random) {
  double total_area = 0;
  std::vector<double> areas;
  for (const WorldBox& box : boxes_) {
    const Eigen::Vector3d size = 2 * box.half_size;
    areas.push_back(size.x() * size.y() + size.y() * size.z() + size.z() * size.x());
    total_area += areas.back();
    for (int corner = 0; corner < 8; ++corner) {
      points_.push_back(box.ToWorld(box.half_size.cwiseProduct(Corner(corner))));
      for (const int axis_bit : {1, 2, 4}) {
        if (corner & axis_bit) continue;
        segments_.push_back({box.ToWorld(box.half_size.cwiseProduct(Corner(corner))),
                             box.ToWorld(box.half_size.cwiseProduct(Corner(corner | axis_bit)))});
      }
    }
  }
  for (int i = 0; i < num_points; ++i) {
    double pick = Uniform(random, 0, total_area);
    std::size_t index = 0;
    while (index + 1 < boxes_.size() && pick > areas[index]) pick -= areas[index++];
    const int axis = static_cast<int>(random() % 3);
    Eigen::Vector3d local(Uniform(random, -1, 1), Uniform(random, -1, 1), Uniform(random, -1, 1));
    local[axis] = local[axis] < 0 ? -1 : 1;
    points_.push_back(boxes_[index].ToWorld(local.cwiseProduct(boxes_[index].half_size)));
  }
}

std::optional<RayHit> SyntheticWorld::Cast(const Eigen::Vector3d& origin,
                                           const Eigen::Vector3d& direction) const {
  std::optional<RayHit> best;
  for (std::size_t i = 0; i < boxes_.size(); ++i) {
    auto hit = CastBox(boxes_[i], i == 0, boxes_[i].ToLocal(origin),
                       boxes_[i].DirectionToLocal(direction));
    if (hit && (!best || hit->distance < best->distance)) {
      best = hit;
      best->box = static_cast<int>(i);
    }
  }
  return best;
}

bool SyntheticWorld::Visible(const Eigen::Vector3d& eye,
                             const Eigen::Vector3d& point_in_world) const {
  const Eigen::Vector3d ray = point_in_world - eye;
  const double length = ray.norm();
  if (length < 1e-9) return false;
  const auto hit = Cast(eye, ray / length);
  return !hit || hit->distance > length - kOnSurface;
}

std::vector<VisiblePoint> ObservePoints(const SyntheticWorld& world, const DistortedCamera& camera,
                                        const Rigid3& world_from_cam, double pixel_noise,
                                        std::mt19937& random) {
  const Rigid3 cam_from_world = world_from_cam.Inverse();
  std::vector<VisiblePoint> observations;
  for (std::size_t i = 0; i < world.points().size(); ++i) {
    const Eigen::Vector3d& point = world.points()[i];
    const auto pixel = SeenAt(world, camera, world_from_cam, cam_from_world, point);
    if (!pixel) continue;
    observations.push_back(
        {static_cast<int>(i), *pixel + Noise(pixel_noise, random), (cam_from_world * point).z()});
  }
  return observations;
}

std::vector<SegmentObservation> ObserveSegments(const SyntheticWorld& world,
                                                const DistortedCamera& camera,
                                                const Rigid3& world_from_cam, double pixel_noise,
                                                double min_pixels, std::mt19937& random) {
  const Rigid3 cam_from_world = world_from_cam.Inverse();
  std::vector<SegmentObservation> observations;
  for (std::size_t i = 0; i < world.segments().size(); ++i) {
    const WorldSegment& segment = world.segments()[i];
    const auto point_at = [&segment](int sample) -> Eigen::Vector3d {
      return segment.start +
             (segment.end - segment.start) * (static_cast<double>(sample) / kSegmentSamples);
    };
    std::array<bool, kSegmentSamples + 1> visible;
    for (int k = 0; k <= kSegmentSamples; ++k) {
      visible[k] = SeenAt(world, camera, world_from_cam, cam_from_world, point_at(k)).has_value();
    }
    const auto [first, last] = LongestRun(visible);
    if (first >= last) continue;
    SegmentObservation seen;
    seen.segment = static_cast<int>(i);
    seen.start_in_world = point_at(first);
    seen.end_in_world = point_at(last);
    seen.start = camera.Project(cam_from_world * seen.start_in_world);
    seen.end = camera.Project(cam_from_world * seen.end_in_world);
    if ((seen.end - seen.start).norm() < min_pixels) continue;
    seen.start += Noise(pixel_noise, random);
    seen.end += Noise(pixel_noise, random);
    observations.push_back(seen);
  }
  return observations;
}

}  // namespace airslam
