// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <optional>

#include "airslam/geometry/pinhole.h"
#include "airslam/geometry/rigid3.h"

namespace airslam {

// A straight, endless line of space in Plücker coordinates (paper, section V-C, "3D Line
// Representation"), in the frame that its name tells (`line_in_world`). (n, v) and (-n, -v) are the
// same line.
struct PluckerLine {
  // Moment X x v of any point X of the line, metres: normal to the plane through the line and the
  // frame's origin, as long as the line is far from the origin; zero for a line through it.
  Eigen::Vector3d n = Eigen::Vector3d::Zero();
  Eigen::Vector3d v = Eigen::Vector3d::UnitZ();  // direction, of length 1

  // The line through two points, directed from the first to the second. (The paper's n = X1 x X2
  // with v of length 1 is no line: n must be divided by the same length, and its sign is turned.)
  // Returns nothing when the points lie less than `min_distance` metres apart: their line is
  // uncertain.
  static std::optional<PluckerLine> FromPoints(const Eigen::Vector3d& first,
                                               const Eigen::Vector3d& second,
                                               double min_distance = 0.01);

  // The point of the line that lies nearest to the origin, or to `point`.
  Eigen::Vector3d Closest() const { return v.cross(n); }
  Eigen::Vector3d Closest(const Eigen::Vector3d& point) const;

  // Metres between the line and a point.
  double Distance(const Eigen::Vector3d& point) const { return (point.cross(v) - n).norm(); }
};

// The line seen from another frame: L_b = [R, [t]x R; 0, R] L_a with b_from_a = (R, t) (paper,
// section V-C, "Re-projection").
PluckerLine operator*(const Rigid3& b_from_a, const PluckerLine& line_in_a);

// The point of `line` that lies nearest to another line. Returns nothing when they are parallel
// (sine of their angle below 1e-6).
std::optional<Eigen::Vector3d> ClosestToLine(const PluckerLine& line, const PluckerLine& other);

// Orthonormal representation (U, W) in SO(3) x SO(2), 4 degrees of freedom (paper, section V-C, "3D
// Line Representation"; Bartoli and Sturm, "Structure-from-motion using lines", CVIU 2005): the
// columns of U are n/|n|, v and n/|n| x v; W turns by the angle of (cos, sin) = (|n|, |v|) / |L|.
struct OrthonormalLine {
  Eigen::Quaterniond u = Eigen::Quaterniond::Identity();  // unit quaternion of U
  Eigen::Vector2d w = Eigen::Vector2d::UnitY();           // first column of W, of length 1
};

// A line through the origin has no n/|n|: any direction across v stands in, always the same one.
OrthonormalLine ToOrthonormal(const PluckerLine& line);

// Returns nothing for a line at infinity (|w_2| < 1e-9).
std::optional<PluckerLine> FromOrthonormal(const OrthonormalLine& line);

// The two end points of a line seen in an image, pixels.
struct ImageSegment {
  Eigen::Vector2d start = Eigen::Vector2d::Zero();
  Eigen::Vector2d end = Eigen::Vector2d::Zero();

  double Length() const { return (end - start).norm(); }
};

// A stretch of a line in space, metres.
struct SpaceSegment {
  Eigen::Vector3d start = Eigen::Vector3d::Zero();
  Eigen::Vector3d end = Eigen::Vector3d::Zero();
};

// The endless line a x + b y + c = 0 of an image, pixels, with a^2 + b^2 = 1.
struct ImageLine {
  double a = 1, b = 0, c = 0;

  // Through the end points; nothing when they lie less than 1e-6 pixels apart.
  static std::optional<ImageLine> Through(const ImageSegment& segment);

  // In pixels; the sign tells the side. Its amount is the paper's d(p, l) (section V-B).
  double SignedDistance(const Eigen::Vector2d& pixel) const {
    return a * pixel.x() + b * pixel.y() + c;
  }
  double Distance(const Eigen::Vector2d& pixel) const { return std::abs(SignedDistance(pixel)); }

  // The pixel of the line nearest to `pixel`.
  Eigen::Vector2d Foot(const Eigen::Vector2d& pixel) const {
    return pixel - SignedDistance(pixel) * Eigen::Vector2d(a, b);
  }
};

// K so that K n_cam is the projected line (not normalised):
// [fy 0 0; 0 fx 0; -fy cx, -fx cy, fx fy]. The paper prints fx and fy of the diagonal swapped.
Eigen::Matrix3d LineProjection(const Pinhole& camera);

// The image of a line. The endless line is projected, whatever part of it lies before the camera.
// Returns nothing when it has no image: it passes within a millimetre of the camera's centre, or
// its image lies beyond all fields of view (more than 10,000 focal lengths from the image's
// centre).
std::optional<ImageLine> ProjectLine(const Pinhole& camera, const PluckerLine& line_in_cam);

// The larger of the distances of the two end points from the projected line, pixels; infinite when
// the line has no image.
double EndPointError(const Pinhole& camera, const PluckerLine& line_in_cam,
                     const ImageSegment& segment);

// The point of the line (camera frame) that is seen nearest to `pixel`: on the ray through the foot
// of the pixel on the projected line. Returns nothing when that point lies less than `min_depth`
// metres (z) before the camera, when the line is seen end-on there (the angle to the ray is below
// 0.01 rad), or when it has no image.
std::optional<Eigen::Vector3d> PointSeenAt(const Pinhole& camera, const PluckerLine& line_in_cam,
                                           const Eigen::Vector2d& pixel, double min_depth = 0.05);

// The stretch of the line (camera frame) that an observed segment shows: both end points as by
// PointSeenAt. For drawing, for depth checks, and to give the endless line of the map its ends.
std::optional<SpaceSegment> SegmentSeenAt(const Pinhole& camera, const PluckerLine& line_in_cam,
                                          const ImageSegment& segment, double min_depth = 0.05);

}  // namespace airslam
