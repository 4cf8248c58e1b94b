// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>

#include "airslam/geometry/pinhole.h"
#include "airslam/geometry/plucker_line.h"
#include "airslam/geometry/rigid3.h"

namespace airslam {

// One observed segment of a line. For the right image of a stereo pair: the same camera and
// RightFromLeft(stereo) * left_from_world.
struct LineSighting {
  Rigid3 cam_from_world;
  Pinhole camera;
  ImageSegment segment;  // pixels
};

// Where the points of the left camera lie in the right one: `baseline` to the left.
inline Rigid3 RightFromLeft(const StereoCamera& stereo) {
  return {Eigen::Quaterniond::Identity(), Eigen::Vector3d(-stereo.baseline, 0, 0)};
}

// A triangulated point that belongs to the segment of a sighting (point_line_association.h).
struct LinePoint {
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();  // in that sighting's image
  Eigen::Vector3d point_in_world = Eigen::Vector3d::Zero();
};

struct LineTriangulationOptions {
  double min_segment = 10;  // pixels: shorter segments say nothing of the direction
  double min_depth = 0.1;   // metres, z of both ends in every camera
  double max_depth = 100;   // metres
  // Two planes. The angle alone does not see a line along the epipolar direction (a horizontal one
  // in a stereo pair), where noise opens the angle: so also the error of the depths that
  // `pixel_sigma` of each end point makes is bounded, as a share of the depth.
  double min_plane_angle = 0.01;  // radians, in [0, pi/2]
  double pixel_sigma = 1;         // pixels
  double max_depth_error = 0.2;
  // Two points: at least this far apart in space and along the segment in the image.
  double min_point_distance = 0.05;  // metres
  double min_point_share = 0.2;      // of the segment's length
  // Either: the largest distance in pixels of an observed end point from the projected line.
  double max_end_error = 3;
};

enum class LineOutcome {
  kNotTried,
  kOk,
  kTooFewSightings,  // two planes need two
  kShortSegment,     // no segment (or fewer than two) of at least min_segment
  kParallelPlanes,   // degenerate: the planes meet at less than min_plane_angle
  kUncertainDepth,   // degenerate: noise of the end points moves the line too far
  kDepthOutOfRange,  // an end lies behind a camera, too near or too far
  kTooFewPoints,     // fewer than two points
  kPointsTooClose,   // no two points far enough apart
  kMissesSegment,    // an observed end point lies more than max_end_error from the line
};

// A few words for logs.
const char* ToString(LineOutcome outcome);

enum class LineMethod { kTwoPlanes, kTwoPoints };

struct LineTriangulation {
  std::optional<PluckerLine> line_in_world;
  LineMethod method = LineMethod::kTwoPlanes;  // that gave the line
  LineOutcome planes = LineOutcome::kNotTried;
  LineOutcome points = LineOutcome::kNotTried;  // tried only where the planes failed

  explicit operator bool() const { return line_in_world.has_value(); }
};

// The line where the planes through two of the sightings meet (paper, section V-C,
// "Triangulation"; Yang et al., ICRA 2019, algorithm B): of all pairs the two whose planes meet at
// the largest angle. The line must fit all sightings. Two sightings always fit, whatever they show:
// with a third a wrong match is noticed.
LineTriangulation TriangulateFromPlanes(std::span<const LineSighting> sightings,
                                        const LineTriangulationOptions& options = {});

// The line through two triangulated points that belong to the segment of `sightings[0]`: the two
// nearest to it in the image (paper, same section) that are far enough apart. Of pairs with the
// same farther point the one with the nearer other point; ties go to the earlier in `points`. The
// line must fit all sightings.
LineTriangulation TriangulateFromPoints(std::span<const LineSighting> sightings,
                                        std::span<const LinePoint> points,
                                        const LineTriangulationOptions& options = {});

// From planes, or else from points. `points` belong to `sightings[0]`.
LineTriangulation TriangulateLine(std::span<const LineSighting> sightings,
                                  std::span<const LinePoint> points,
                                  const LineTriangulationOptions& options = {});

}  // namespace airslam
