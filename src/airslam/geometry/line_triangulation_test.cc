// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/geometry/line_triangulation.h"

#include <gtest/gtest.h>

#include <random>
#include <string>
#include <vector>

#include "airslam/geometry/so3.h"

namespace airslam {
namespace {

const StereoCamera kStereo{{450, 420, 320, 240, 640, 480}, 0.12};
const Rigid3 kLeftFromWorld{ExpSO3({0.1, -0.3, 0.2}), {4.0, -3.0, 1.0}};

LineSighting See(const Rigid3& cam_from_world, const SpaceSegment& in_world) {
  const Pinhole& camera = kStereo.camera;
  return {cam_from_world,
          camera,
          {camera.Project(cam_from_world * in_world.start),
           camera.Project(cam_from_world * in_world.end)}};
}

// Given in the frame of the left camera.
SpaceSegment InWorld(const Eigen::Vector3d& start, const Eigen::Vector3d& end) {
  const Rigid3 world_from_left = kLeftFromWorld.Inverse();
  return {world_from_left * start, world_from_left * end};
}

std::vector<LineSighting> SeeInStereo(const SpaceSegment& in_world) {
  return {See(kLeftFromWorld, in_world), See(RightFromLeft(kStereo) * kLeftFromWorld, in_world)};
}

const SpaceSegment kUpright = InWorld({-0.3, -0.8, 3.0}, {0.2, 0.7, 3.4});
const SpaceSegment kLevel = InWorld({-0.9, 0.3, 3.0}, {0.7, 0.3, 3.0});
const Rigid3 kMoved = Rigid3(ExpSO3({0.02, -0.03, 0.01}), {0.1, 0.3, -0.05}) * kLeftFromWorld;

void ExpectLine(const LineTriangulation& result, const SpaceSegment& truth, double tolerance) {
  ASSERT_TRUE(result) << ToString(result.planes) << ", " << ToString(result.points);
  EXPECT_LT(result.line_in_world->Distance(truth.start), tolerance);
  EXPECT_LT(result.line_in_world->Distance(truth.end), tolerance);
}

// A point at `share` of a segment, its pixel moved across by `offset` pixels.
LinePoint PointOn(const SpaceSegment& in_world, double share, double offset) {
  const Eigen::Vector3d point = in_world.start + share * (in_world.end - in_world.start);
  const ImageSegment seen = See(kLeftFromWorld, in_world).segment;
  const Eigen::Vector2d along = (seen.end - seen.start).normalized();
  return {kStereo.camera.Project(kLeftFromWorld * point) +
              offset * Eigen::Vector2d(-along.y(), along.x()),
          point};
}

TEST(TriangulateFromPlanes, IsExactWithoutNoise) {
  const LineTriangulation stereo = TriangulateFromPlanes(SeeInStereo(kUpright));
  ExpectLine(stereo, kUpright, 1e-9);
  EXPECT_EQ(stereo.method, LineMethod::kTwoPlanes);
  EXPECT_EQ(stereo.planes, LineOutcome::kOk);
  EXPECT_EQ(stereo.points, LineOutcome::kNotTried);
  const std::vector<LineSighting> motion = {See(kLeftFromWorld, kLevel), See(kMoved, kLevel)};
  ExpectLine(TriangulateFromPlanes(motion), kLevel, 1e-9);
}

TEST(TriangulateFromPlanes, TheSegmentsNeedNotShowTheSameStretch) {
  std::vector<LineSighting> sightings = SeeInStereo(kUpright);
  const Eigen::Vector2d along = sightings[1].segment.end - sightings[1].segment.start;
  sightings[1].segment.start += 0.5 * along;
  sightings[1].segment.end += 0.2 * along;
  ExpectLine(TriangulateFromPlanes(sightings), kUpright, 1e-9);
}

TEST(TriangulateFromPlanes, LineInTheEpipolarPlaneIsDegenerate) {
  EXPECT_EQ(TriangulateFromPlanes(SeeInStereo(kLevel)).planes, LineOutcome::kParallelPlanes);
}

TEST(TriangulateFromPlanes, NoiseDoesNotMakeADegenerateLineGood) {
  // Noise of a pixel opens the angle between the planes of a level line; its depth stays unknown.
  std::mt19937 random(5);
  std::normal_distribution<double> noise(0, 1);
  LineTriangulationOptions options;
  options.min_plane_angle = 0;
  int refused = 0;
  for (int i = 0; i < 100; ++i) {
    std::vector<LineSighting> sightings = SeeInStereo(kLevel);
    for (LineSighting& s : sightings) {
      s.segment.start.y() += noise(random);
      s.segment.end.y() += noise(random);
    }
    const LineTriangulation result = TriangulateFromPlanes(sightings, options);
    EXPECT_TRUE(result.planes == LineOutcome::kUncertainDepth ||
                result.planes == LineOutcome::kDepthOutOfRange)
        << ToString(result.planes);
    refused += !result;
  }
  EXPECT_EQ(refused, 100);
}

TEST(TriangulateFromPlanes, TheDepthErrorIsThatOfNoise) {
  // An upright line in stereo: sigma_z / z = sigma_disparity / disparity, where the noise of both
  // ends of both segments counts.
  const SpaceSegment upright = InWorld({0, -0.8, 3.0}, {0, 0.8, 3.0});
  const double share = std::sqrt(2.0) / kStereo.Disparity(3.0);
  LineTriangulationOptions options;
  options.max_depth_error = 1.15 * share;
  EXPECT_TRUE(TriangulateFromPlanes(SeeInStereo(upright), options));
  options.max_depth_error = 0.9 * share;
  EXPECT_EQ(TriangulateFromPlanes(SeeInStereo(upright), options).planes,
            LineOutcome::kUncertainDepth);
}

TEST(TriangulateFromPlanes, ChoosesTheBestPairOfManySightings) {
  std::vector<LineSighting> sightings = SeeInStereo(kLevel);
  sightings.push_back(See(kMoved, kLevel));
  ExpectLine(TriangulateFromPlanes(sightings), kLevel, 1e-9);
}

TEST(TriangulateFromPlanes, AThirdSightingFindsAWrongMatch) {
  std::vector<LineSighting> sightings = SeeInStereo(kUpright);
  sightings.push_back(See(kMoved, kUpright));
  ExpectLine(TriangulateFromPlanes(sightings), kUpright, 1e-9);
  sightings[2].segment.start.x() += 12;
  sightings[2].segment.end.x() += 12;
  EXPECT_EQ(TriangulateFromPlanes(sightings).planes, LineOutcome::kMissesSegment);
}

TEST(TriangulateFromPlanes, SaysWhyNot) {
  std::vector<LineSighting> sightings = SeeInStereo(kUpright);
  EXPECT_EQ(TriangulateFromPlanes({sightings.data(), 1}).planes, LineOutcome::kTooFewSightings);
  EXPECT_EQ(TriangulateFromPlanes(sightings, {.max_depth = 3.1}).planes,
            LineOutcome::kDepthOutOfRange);
  std::swap(sightings[0].segment, sightings[1].segment);  // negative disparity: behind the cameras
  EXPECT_EQ(TriangulateFromPlanes(sightings).planes, LineOutcome::kDepthOutOfRange);
  sightings[0].segment.end = sightings[0].segment.start + Eigen::Vector2d(3, 3);
  EXPECT_EQ(TriangulateFromPlanes(sightings).planes, LineOutcome::kShortSegment);
}

TEST(TriangulateFromPoints, TakesTheTwoNearestInTheImage) {
  std::vector<LinePoint> points = {PointOn(kLevel, 0.1, 2.5), PointOn(kLevel, 0.9, 0.4),
                                   PointOn(kLevel, 0.5, -2.0), PointOn(kLevel, 0.2, -0.3)};
  points[0].point_in_world.x() += 0.5;  // were they used, the line would be wrong
  points[2].point_in_world.y() += 0.5;
  const std::vector<LineSighting> sightings = SeeInStereo(kLevel);
  const LineTriangulation result = TriangulateFromPoints(sightings, points);
  ExpectLine(result, kLevel, 1e-9);
  EXPECT_EQ(result.method, LineMethod::kTwoPoints);
  EXPECT_EQ(result.points, LineOutcome::kOk);
}

TEST(TriangulateFromPoints, PassesOverPairsThatLieCloseTogether) {
  const std::vector<LineSighting> sightings = SeeInStereo(kLevel);
  std::vector<LinePoint> points = {PointOn(kLevel, 0.50, 0.1), PointOn(kLevel, 0.51, 0.2)};
  points[0].point_in_world.z() += 0.2;
  EXPECT_EQ(TriangulateFromPoints(sightings, points).points, LineOutcome::kPointsTooClose);
  points[0].point_in_world.z() -= 0.2;
  points.push_back(PointOn(kLevel, 0.9, 1.0));
  ExpectLine(TriangulateFromPoints(sightings, points), kLevel, 1e-9);
}

TEST(TriangulateFromPoints, SaysWhyNot) {
  const std::vector<LineSighting> sightings = SeeInStereo(kLevel);
  std::vector<LinePoint> points = {PointOn(kLevel, 0.1, 0), PointOn(kLevel, 0.9, 0)};
  EXPECT_EQ(TriangulateFromPoints({}, points).points, LineOutcome::kTooFewSightings);
  EXPECT_EQ(TriangulateFromPoints(sightings, {points.data(), 1}).points,
            LineOutcome::kTooFewPoints);
  EXPECT_EQ(TriangulateFromPoints(sightings, points, {.min_segment = 600}).points,
            LineOutcome::kShortSegment);
  EXPECT_EQ(TriangulateFromPoints(sightings, points, {.max_depth = 2}).points,
            LineOutcome::kDepthOutOfRange);
  points[0].point_in_world += kLeftFromWorld.Inverse().rotation * Eigen::Vector3d(0, 0.1, 0);
  EXPECT_EQ(TriangulateFromPoints(sightings, points).points, LineOutcome::kMissesSegment);
}

TEST(TriangulateLine, FallsBackToPointsWherePlanesAreDegenerate) {
  const std::vector<LinePoint> points = {PointOn(kLevel, 0.1, 1), PointOn(kLevel, 0.8, 0)};
  const LineTriangulation level = TriangulateLine(SeeInStereo(kLevel), points);
  ExpectLine(level, kLevel, 1e-9);
  EXPECT_EQ(level.method, LineMethod::kTwoPoints);
  EXPECT_EQ(level.planes, LineOutcome::kParallelPlanes);
  const LineTriangulation upright = TriangulateLine(SeeInStereo(kUpright), points);
  ExpectLine(upright, kUpright, 1e-9);
  EXPECT_EQ(upright.method, LineMethod::kTwoPlanes);
  const LineTriangulation none = TriangulateLine(SeeInStereo(kLevel), {});
  EXPECT_FALSE(none);
  EXPECT_EQ(none.planes, LineOutcome::kParallelPlanes);
  EXPECT_EQ(none.points, LineOutcome::kTooFewPoints);
  EXPECT_EQ(std::string(ToString(none.points)), "too few points");
}

}  // namespace
}  // namespace airslam
