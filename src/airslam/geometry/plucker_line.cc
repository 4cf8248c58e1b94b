// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/geometry/plucker_line.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace airslam {
namespace {

constexpr double kMinParallelSine = 1e-6;
constexpr double kMinInfinity = 1e-9;        // of |w_2|
constexpr double kMinPixels = 1e-6;          // between the end points of a segment
constexpr double kMinCentreDistance = 1e-3;  // metres between a line and the camera's centre
constexpr double kMinSlope = 1e-4;      // of the plane through line and centre: 1 / focal lengths
constexpr double kMinSightSine = 0.01;  // between a line and the ray to it

// A unit vector across v: v turned towards the axis that it is least aligned with.
Eigen::Vector3d Across(const Eigen::Vector3d& v) {
  Eigen::Index axis;
  v.cwiseAbs().minCoeff(&axis);
  return v.cross(Eigen::Vector3d::Unit(axis)).normalized();
}

}  // namespace

std::optional<PluckerLine> PluckerLine::FromPoints(const Eigen::Vector3d& first,
                                                   const Eigen::Vector3d& second,
                                                   double min_distance) {
  const Eigen::Vector3d difference = second - first;
  const double distance = difference.norm();
  if (!(distance >= min_distance && distance > 0)) return std::nullopt;
  const Eigen::Vector3d direction = difference / distance;
  return PluckerLine{first.cross(direction), direction};
}

Eigen::Vector3d PluckerLine::Closest(const Eigen::Vector3d& point) const {
  return Closest() + v.dot(point) * v;
}

PluckerLine operator*(const Rigid3& b_from_a, const PluckerLine& line_in_a) {
  const Eigen::Vector3d v = b_from_a.rotation * line_in_a.v;
  return {b_from_a.rotation * line_in_a.n + b_from_a.translation.cross(v), v};
}

std::optional<Eigen::Vector3d> ClosestToLine(const PluckerLine& line, const PluckerLine& other) {
  // The wanted point lies in the plane that holds `other` and the common perpendicular c; its
  // normal is m = v_other x c.
  const Eigen::Vector3d c = line.v.cross(other.v);
  const double square = c.squaredNorm();
  if (!(square > kMinParallelSine * kMinParallelSine)) return std::nullopt;
  const Eigen::Vector3d m = other.v.cross(c);
  const Eigen::Vector3d foot = line.Closest();
  return foot + (c.dot(other.n) - m.dot(foot)) / square * line.v;
}

OrthonormalLine ToOrthonormal(const PluckerLine& line) {
  const Eigen::Vector3d v = line.v.normalized();
  const Eigen::Vector3d n = line.n / line.v.norm();
  Eigen::Vector3d across = n - v.dot(n) * v;
  const double distance = across.norm();
  across = distance > 1e-12 ? Eigen::Vector3d(across / distance) : Across(v);
  Eigen::Matrix3d u;
  u << across, v, across.cross(v);
  return {Eigen::Quaterniond(u).normalized(), Eigen::Vector2d(distance, 1).normalized()};
}

std::optional<PluckerLine> FromOrthonormal(const OrthonormalLine& line) {
  if (!(std::abs(line.w.y()) >= kMinInfinity)) return std::nullopt;
  const Eigen::Matrix3d u = line.u.normalized().toRotationMatrix();
  return PluckerLine{line.w.x() / line.w.y() * u.col(0), u.col(1)};
}

std::optional<ImageLine> ImageLine::Through(const ImageSegment& segment) {
  const double length = segment.Length();
  if (!(length >= kMinPixels)) return std::nullopt;
  const Eigen::Vector2d along = (segment.end - segment.start) / length;
  const Eigen::Vector2d middle = 0.5 * (segment.start + segment.end);
  return ImageLine{-along.y(), along.x(), along.y() * middle.x() - along.x() * middle.y()};
}

Eigen::Matrix3d LineProjection(const Pinhole& camera) {
  Eigen::Matrix3d projection;
  projection << camera.fy, 0, 0,  //
      0, camera.fx, 0,            //
      -camera.fy * camera.cx, -camera.fx * camera.cy, camera.fx * camera.fy;
  return projection;
}

std::optional<ImageLine> ProjectLine(const Pinhole& camera, const PluckerLine& line_in_cam) {
  const Eigen::Vector3d& n = line_in_cam.n;
  const double slope = n.head<2>().norm();
  if (!(n.norm() > kMinCentreDistance && slope > kMinSlope * n.norm())) return std::nullopt;
  const Eigen::Vector3d line = LineProjection(camera) * n;
  const double length = line.head<2>().norm();
  return ImageLine{line.x() / length, line.y() / length, line.z() / length};
}

double EndPointError(const Pinhole& camera, const PluckerLine& line_in_cam,
                     const ImageSegment& segment) {
  const std::optional<ImageLine> line = ProjectLine(camera, line_in_cam);
  if (!line) return std::numeric_limits<double>::infinity();
  return std::max(line->Distance(segment.start), line->Distance(segment.end));
}

std::optional<Eigen::Vector3d> PointSeenAt(const Pinhole& camera, const PluckerLine& line_in_cam,
                                           const Eigen::Vector2d& pixel, double min_depth) {
  const std::optional<ImageLine> line = ProjectLine(camera, line_in_cam);
  if (!line) return std::nullopt;
  // A point X = z ray of the line has X x v = n. The ray lies in the plane across n, so that
  // ray x v is parallel to n.
  const Eigen::Vector3d ray = camera.Unproject(line->Foot(pixel));
  const Eigen::Vector3d moment = ray.cross(line_in_cam.v);
  if (!(moment.norm() >= kMinSightSine * ray.norm())) return std::nullopt;
  const double z = line_in_cam.n.dot(moment) / moment.squaredNorm();
  if (!(z >= min_depth)) return std::nullopt;
  return z * ray;
}

std::optional<SpaceSegment> SegmentSeenAt(const Pinhole& camera, const PluckerLine& line_in_cam,
                                          const ImageSegment& segment, double min_depth) {
  const auto start = PointSeenAt(camera, line_in_cam, segment.start, min_depth);
  const auto end = PointSeenAt(camera, line_in_cam, segment.end, min_depth);
  if (!start || !end) return std::nullopt;
  return SpaceSegment{*start, *end};
}

}  // namespace airslam
