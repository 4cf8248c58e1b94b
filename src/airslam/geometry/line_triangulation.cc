// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/geometry/line_triangulation.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace airslam {
namespace {

// Unit normal, in the camera frame, of the plane through the camera's centre and the segment.
Eigen::Vector3d PlaneNormal(const Pinhole& camera, const ImageSegment& segment) {
  return camera.Unproject(segment.start).cross(camera.Unproject(segment.end)).normalized();
}

// Angle between two planes with unit normals, in [0, pi/2].
double PlaneAngle(const Eigen::Vector3d& normal1, const Eigen::Vector3d& normal2) {
  return std::atan2(normal1.cross(normal2).norm(), std::abs(normal1.dot(normal2)));
}

// Where two planes meet. Everything in the frame of the first camera: normal1 through its origin,
// normal2 through centre2. A point X of both has normal1.X = 0 and normal2.X = normal2.centre2.
PluckerLine Intersect(const Eigen::Vector3d& normal1, const Eigen::Vector3d& normal2,
                      const Eigen::Vector3d& centre2) {
  const Eigen::Vector3d direction = normal1.cross(normal2);
  const double length = direction.norm();
  return {normal2.dot(centre2) / length * normal1, direction / length};
}

// Two sightings, in the frame of the first camera.
struct PlanePair {
  Pinhole camera1, camera2;
  ImageSegment segment1, segment2;
  Rigid3 first_from_second;

  PluckerLine Line() const {
    return Intersect(PlaneNormal(camera1, segment1),
                     first_from_second.rotation * PlaneNormal(camera2, segment2),
                     first_from_second.translation);
  }
};

// How far the depths of the ends move when each of the four observed end points is moved by sigma
// across its segment: the root of the sum of the squares, as a share of the depth, of the worse end
// of the first segment. Negative when an end cannot be seen at all.
double DepthError(const PlanePair& pair, double sigma) {
  const ImageSegment ends = pair.segment1;
  const auto exact = SegmentSeenAt(pair.camera1, pair.Line(), ends, 0);
  if (!exact) return -1;
  double start_squares = 0, end_squares = 0;
  for (int k = 0; k < 4; ++k) {
    PlanePair moved = pair;
    ImageSegment& segment = k < 2 ? moved.segment1 : moved.segment2;
    const Eigen::Vector2d along = (segment.end - segment.start).normalized();
    (k % 2 == 0 ? segment.start : segment.end) += sigma * Eigen::Vector2d(-along.y(), along.x());
    const auto seen = SegmentSeenAt(pair.camera1, moved.Line(), ends, 0);
    if (!seen) return -1;
    const double start_error = seen->start.z() / exact->start.z() - 1;
    const double end_error = seen->end.z() / exact->end.z() - 1;
    start_squares += start_error * start_error;
    end_squares += end_error * end_error;
  }
  return std::sqrt(std::max(start_squares, end_squares));
}

// Whether the line lies before every camera that sees it, and where it was seen.
LineOutcome Verify(std::span<const LineSighting> sightings, const PluckerLine& line_in_world,
                   const LineTriangulationOptions& options) {
  for (const LineSighting& sighting : sightings) {
    const PluckerLine line_in_cam = sighting.cam_from_world * line_in_world;
    const auto ends =
        SegmentSeenAt(sighting.camera, line_in_cam, sighting.segment, options.min_depth);
    if (!ends || ends->start.z() > options.max_depth || ends->end.z() > options.max_depth) {
      return LineOutcome::kDepthOutOfRange;
    }
    if (!(EndPointError(sighting.camera, line_in_cam, sighting.segment) <= options.max_end_error)) {
      return LineOutcome::kMissesSegment;
    }
  }
  return LineOutcome::kOk;
}

LineOutcome FromPlanes(std::span<const LineSighting> sightings,
                       const LineTriangulationOptions& options,
                       std::optional<PluckerLine>* line_in_world) {
  if (sightings.size() < 2) return LineOutcome::kTooFewSightings;
  double best_angle = -1;
  std::array<std::size_t, 2> best = {0, 0};
  for (std::size_t i = 0; i < sightings.size(); ++i) {
    const LineSighting& first = sightings[i];
    if (!(first.segment.Length() >= options.min_segment)) continue;
    const Eigen::Vector3d normal1 =
        first.cam_from_world.rotation.conjugate() * PlaneNormal(first.camera, first.segment);
    for (std::size_t j = i + 1; j < sightings.size(); ++j) {
      const LineSighting& second = sightings[j];
      if (!(second.segment.Length() >= options.min_segment)) continue;
      const Eigen::Vector3d normal2 =
          second.cam_from_world.rotation.conjugate() * PlaneNormal(second.camera, second.segment);
      const double angle = PlaneAngle(normal1, normal2);
      if (angle <= best_angle) continue;
      best_angle = angle;
      best = {i, j};
    }
  }
  if (best_angle < 0) return LineOutcome::kShortSegment;
  if (best_angle < options.min_plane_angle) return LineOutcome::kParallelPlanes;
  const LineSighting& first = sightings[best[0]];
  const LineSighting& second = sightings[best[1]];
  const Rigid3 world_from_first = first.cam_from_world.Inverse();
  const PlanePair pair{first.camera, second.camera, first.segment, second.segment,
                       first.cam_from_world * second.cam_from_world.Inverse()};
  const PluckerLine line = world_from_first * pair.Line();
  const LineOutcome outcome = Verify(sightings, line, options);
  if (outcome != LineOutcome::kOk) return outcome;
  const double error = DepthError(pair, options.pixel_sigma);
  if (!(error >= 0 && error <= options.max_depth_error)) return LineOutcome::kUncertainDepth;
  *line_in_world = line;
  return LineOutcome::kOk;
}

// Whether two points lie far enough apart to give a direction.
bool FarApart(const LinePoint& a, const LinePoint& b, double min_pixels,
              const LineTriangulationOptions& options) {
  return (a.pixel - b.pixel).norm() >= min_pixels &&
         (a.point_in_world - b.point_in_world).norm() >= options.min_point_distance;
}

LineOutcome FromPoints(std::span<const LineSighting> sightings, std::span<const LinePoint> points,
                       const LineTriangulationOptions& options,
                       std::optional<PluckerLine>* line_in_world) {
  if (sightings.empty()) return LineOutcome::kTooFewSightings;
  const ImageSegment& segment = sightings[0].segment;
  const std::optional<ImageLine> image_line = ImageLine::Through(segment);
  if (!image_line || segment.Length() < options.min_segment) return LineOutcome::kShortSegment;
  if (points.size() < 2) return LineOutcome::kTooFewPoints;
  std::vector<LinePoint> nearest(points.begin(), points.end());
  std::stable_sort(nearest.begin(), nearest.end(), [&](const LinePoint& a, const LinePoint& b) {
    return image_line->Distance(a.pixel) < image_line->Distance(b.pixel);
  });
  const double min_pixels = options.min_point_share * segment.Length();
  for (std::size_t j = 1; j < nearest.size(); ++j) {
    for (std::size_t i = 0; i < j; ++i) {
      if (!FarApart(nearest[i], nearest[j], min_pixels, options)) continue;
      const auto line = PluckerLine::FromPoints(
          nearest[i].point_in_world, nearest[j].point_in_world, options.min_point_distance);
      if (!line) continue;
      const LineOutcome outcome = Verify(sightings, *line, options);
      if (outcome == LineOutcome::kOk) *line_in_world = line;
      return outcome;
    }
  }
  return LineOutcome::kPointsTooClose;
}

}  // namespace

const char* ToString(LineOutcome outcome) {
  switch (outcome) {
    case LineOutcome::kNotTried:
      return "not tried";
    case LineOutcome::kOk:
      return "ok";
    case LineOutcome::kTooFewSightings:
      return "too few sightings";
    case LineOutcome::kShortSegment:
      return "segment too short";
    case LineOutcome::kParallelPlanes:
      return "planes parallel";
    case LineOutcome::kUncertainDepth:
      return "depth uncertain";
    case LineOutcome::kDepthOutOfRange:
      return "depth out of range";
    case LineOutcome::kTooFewPoints:
      return "too few points";
    case LineOutcome::kPointsTooClose:
      return "points too close together";
    case LineOutcome::kMissesSegment:
      return "misses an observed segment";
  }
  return "unknown";
}

LineTriangulation TriangulateFromPlanes(std::span<const LineSighting> sightings,
                                        const LineTriangulationOptions& options) {
  LineTriangulation result;
  result.planes = FromPlanes(sightings, options, &result.line_in_world);
  return result;
}

LineTriangulation TriangulateFromPoints(std::span<const LineSighting> sightings,
                                        std::span<const LinePoint> points,
                                        const LineTriangulationOptions& options) {
  LineTriangulation result;
  result.method = LineMethod::kTwoPoints;
  result.points = FromPoints(sightings, points, options, &result.line_in_world);
  return result;
}

LineTriangulation TriangulateLine(std::span<const LineSighting> sightings,
                                  std::span<const LinePoint> points,
                                  const LineTriangulationOptions& options) {
  const LineTriangulation by_planes = TriangulateFromPlanes(sightings, options);
  if (by_planes) return by_planes;
  LineTriangulation result = TriangulateFromPoints(sightings, points, options);
  result.planes = by_planes.planes;
  return result;
}

}  // namespace airslam
