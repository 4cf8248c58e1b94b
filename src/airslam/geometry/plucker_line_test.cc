// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/geometry/plucker_line.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "airslam/geometry/so3.h"

namespace airslam {
namespace {

const Pinhole kCamera{450, 390, 320, 230, 640, 480};  // fx differs from fy
const Eigen::Vector3d kFirst(0.4, -0.7, 3.0);
const Eigen::Vector3d kSecond(-0.9, 0.5, 4.5);
const Rigid3 kTransform{Eigen::Quaterniond(0.8, 0.3, -0.4, 0.33), {1.0, -2.0, 0.5}};

PluckerLine Line(const Eigen::Vector3d& first, const Eigen::Vector3d& second) {
  return PluckerLine::FromPoints(first, second).value();
}

void ExpectSameLine(const PluckerLine& line, const PluckerLine& expected) {
  const double sign = line.v.dot(expected.v) < 0 ? -1 : 1;
  EXPECT_LT((sign * line.v - expected.v).norm(), 1e-9);
  EXPECT_LT((sign * line.n - expected.n).norm(), 1e-9);
}

TEST(PluckerLine, FromPointsHoldsBoth) {
  const PluckerLine line = Line(kFirst, kSecond);
  EXPECT_NEAR(line.v.norm(), 1, 1e-12);
  EXPECT_LT((line.v - (kSecond - kFirst).normalized()).norm(), 1e-12);
  for (const double share : {0.0, 1.0, -3.0}) {
    const Eigen::Vector3d point = kFirst + share * (kSecond - kFirst);
    EXPECT_LT((point.cross(line.v) - line.n).norm(), 1e-12) << share;
    EXPECT_LT(line.Distance(point), 1e-12) << share;
  }
}

TEST(PluckerLine, RejectsPointsThatLieCloseTogether) {
  const Eigen::Vector3d near = kFirst + Eigen::Vector3d(0, 0.04, 0);
  EXPECT_FALSE(PluckerLine::FromPoints(kFirst, near, 0.05));
  EXPECT_TRUE(PluckerLine::FromPoints(kFirst, near, 0.03));
  EXPECT_FALSE(PluckerLine::FromPoints(kFirst, kFirst, 0));
  EXPECT_FALSE(PluckerLine::FromPoints(kFirst, Eigen::Vector3d(NAN, 0, 0)));
}

TEST(PluckerLine, DistancesAndClosestPoints) {
  const PluckerLine line{{0, 0, -2}, {1, 0, 0}};  // y = 2, z = 0
  EXPECT_LT((line.Closest() - Eigen::Vector3d(0, 2, 0)).norm(), 1e-12);
  EXPECT_LT((line.Closest({5, 9, 4}) - Eigen::Vector3d(5, 2, 0)).norm(), 1e-12);
  EXPECT_NEAR(line.Distance({5, 5, 4}), 5, 1e-12);
  const PluckerLine other = Line({3, 1, 7}, {3, 5, 7});
  EXPECT_LT((ClosestToLine(line, other).value() - Eigen::Vector3d(3, 2, 0)).norm(), 1e-12);
  EXPECT_LT((ClosestToLine(other, line).value() - Eigen::Vector3d(3, 2, 7)).norm(), 1e-12);
  EXPECT_FALSE(ClosestToLine(line, Line({0, 0, 1}, {-4, 0, 1})));
}

TEST(PluckerLine, TransformsAsItsPointsDo) {
  ExpectSameLine(kTransform * Line(kFirst, kSecond),
                 Line(kTransform * kFirst, kTransform * kSecond));
  ExpectSameLine(kTransform.Inverse() * (kTransform * Line(kFirst, kSecond)),
                 Line(kFirst, kSecond));
}

TEST(PluckerLine, OrthonormalFollowsThePaper) {
  const PluckerLine line = Line(kFirst, kSecond);
  const OrthonormalLine orthonormal = ToOrthonormal(line);
  const Eigen::Matrix3d u = orthonormal.u.toRotationMatrix();
  EXPECT_LT((u.col(0) - line.n.normalized()).norm(), 1e-12);
  EXPECT_LT((u.col(1) - line.v).norm(), 1e-12);
  EXPECT_LT((u.col(2) - line.n.cross(line.v).normalized()).norm(), 1e-12);
  EXPECT_NEAR(orthonormal.w.x() / orthonormal.w.y(), line.n.norm(), 1e-12);
  EXPECT_NEAR(orthonormal.w.norm(), 1, 1e-12);
}

TEST(PluckerLine, OrthonormalAndBack) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal(0, 10);
  for (int i = 0; i < 200; ++i) {
    const Eigen::Vector3d first(normal(random), normal(random), normal(random));
    const PluckerLine line = Line(first, {normal(random), normal(random), normal(random)});
    ExpectSameLine(FromOrthonormal(ToOrthonormal(line)).value(), line);
  }
}

TEST(PluckerLine, OrthonormalOfLinesThroughTheOrigin) {
  for (const Eigen::Vector3d& v : {Eigen::Vector3d(1, 0, 0), Eigen::Vector3d(0, 1, 0),
                                   Eigen::Vector3d(0, 0, -1), Eigen::Vector3d(0.6, 0, 0.8)}) {
    const PluckerLine line{Eigen::Vector3d::Zero(), v};
    const OrthonormalLine orthonormal = ToOrthonormal(line);
    EXPECT_NEAR(orthonormal.u.norm(), 1, 1e-12);
    EXPECT_EQ(orthonormal.w, Eigen::Vector2d(0, 1));
    ExpectSameLine(FromOrthonormal(orthonormal).value(), line);
  }
}

TEST(PluckerLine, TurnedOrthonormalsAreLinesAgain) {
  // Both signs of w, as an optimizer may reach them.
  const OrthonormalLine start = ToOrthonormal(Line(kFirst, kSecond));
  for (const double sign : {1.0, -1.0}) {
    const PluckerLine line = FromOrthonormal({start.u, sign * start.w}).value();
    ExpectSameLine(line, Line(kFirst, kSecond));
  }
  EXPECT_FALSE(FromOrthonormal({start.u, {1, 0}}));  // at infinity
}

TEST(ImageLine, DistanceAndFoot) {
  const ImageLine line = ImageLine::Through({{10, 20}, {40, 60}}).value();
  EXPECT_NEAR(line.Distance({10, 20}), 0, 1e-9);
  EXPECT_NEAR(line.Distance({40, 60}), 0, 1e-9);
  EXPECT_NEAR(line.SignedDistance({10 - 4, 20 + 3}), 5, 1e-9);
  EXPECT_NEAR(line.SignedDistance({10 + 4, 20 - 3}), -5, 1e-9);
  EXPECT_LT((line.Foot({10 - 4, 20 + 3}) - Eigen::Vector2d(10, 20)).norm(), 1e-9);
  EXPECT_FALSE(ImageLine::Through({{10, 20}, {10, 20}}));
}

TEST(ProjectLine, GoesThroughTheProjectedPoints) {
  const Rigid3 cam_from_world(ExpSO3({0.1, -0.2, 0.15}), {0.3, 0.2, 0.4});
  const PluckerLine line_in_cam = cam_from_world * Line(kFirst, kSecond);
  const ImageLine image = ProjectLine(kCamera, line_in_cam).value();
  EXPECT_NEAR(std::hypot(image.a, image.b), 1, 1e-12);
  const ImageSegment seen{kCamera.Project(cam_from_world * kFirst),
                          kCamera.Project(cam_from_world * kSecond)};
  EXPECT_GT(seen.Length(), 100);
  EXPECT_NEAR(image.Distance(seen.start), 0, 1e-9);
  EXPECT_NEAR(image.Distance(seen.end), 0, 1e-9);
  EXPECT_NEAR(EndPointError(kCamera, line_in_cam, seen), 0, 1e-9);
  const Eigen::Vector2d across = Eigen::Vector2d(image.a, image.b);
  EXPECT_NEAR(EndPointError(kCamera, line_in_cam, {seen.start + 2 * across, seen.end - across}), 2,
              1e-9);
}

TEST(ProjectLine, LinesWithoutAnImage) {
  EXPECT_FALSE(ProjectLine(kCamera, Line({0, 0, 0}, {1, 1, 5})));  // through the centre
  EXPECT_FALSE(ProjectLine(kCamera, Line({1, 0, 0}, {1, 1, 0})));  // beside the camera, z = 0
  EXPECT_TRUE(std::isinf(EndPointError(kCamera, Line({1, 0, 0}, {1, 1, 0}), {})));
}

TEST(SegmentSeenAt, CutsTheLineAtTheObservedEnds) {
  const PluckerLine line = Line(kFirst, kSecond);
  const ImageLine image = ProjectLine(kCamera, line).value();
  const Eigen::Vector2d offset = 2.5 * Eigen::Vector2d(image.a, image.b);
  const ImageSegment seen{kCamera.Project(kFirst) + offset, kCamera.Project(kSecond) - offset};
  const SpaceSegment stretch = SegmentSeenAt(kCamera, line, seen).value();
  EXPECT_LT((stretch.start - kFirst).norm(), 1e-9);
  EXPECT_LT((stretch.end - kSecond).norm(), 1e-9);
}

TEST(SegmentSeenAt, RefusesWhatLiesBehindOrIsSeenEndOn) {
  // The camera sees the mirror image of the line behind it at the same pixels.
  const PluckerLine behind = Line(-kFirst, -kSecond);
  const ImageSegment seen{kCamera.Project(kFirst), kCamera.Project(kSecond)};
  EXPECT_LT(EndPointError(kCamera, behind, seen), 1e-9);
  EXPECT_FALSE(SegmentSeenAt(kCamera, behind, seen));
  EXPECT_FALSE(SegmentSeenAt(kCamera, Line(kFirst, kSecond), seen, 3.5));  // the first is at 3 m
  // Along the optical axis, 1 cm beside it: its vanishing point is the image's centre.
  const PluckerLine axial = Line({0.01, 0, 1}, {0.01, 0, 9});
  EXPECT_TRUE(PointSeenAt(kCamera, axial, kCamera.Project({0.01, 0, 0.5})));
  EXPECT_FALSE(PointSeenAt(kCamera, axial, kCamera.Project({0.01, 0, 5})));
}

}  // namespace
}  // namespace airslam
