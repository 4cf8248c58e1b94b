// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/refine/global_bundle.h"

#include <gtest/gtest.h>

#include "airslam/geometry/so3.h"
#include "airslam/refine/test_refine.h"

namespace airslam {
namespace {

// The truth with poses and points shaken, each on its own.
SyntheticMap Shaken() {
  SyntheticMap made = DriftingMap(0);
  std::mt19937 random(5);
  const auto noise = [&](double sigma) {
    return Eigen::Vector3d(sigma * Normal(random), sigma * Normal(random), sigma * Normal(random));
  };
  for (auto& [id, keyframe] : made.map.keyframes) {
    if (id == 0) continue;
    keyframe.world_from_cam = keyframe.world_from_cam * Rigid3(ExpSO3(noise(0.005)), noise(0.03));
  }
  for (auto& [id, landmark] : made.map.landmarks) landmark.point_in_world += noise(0.03);
  return made;
}

// The best that these observations allow is what a bundle finds that begins at the truth.
TEST(GlobalBundle, FindsTheBestAgain) {
  SyntheticMap made = Shaken(), best = DriftingMap(0);
  const double before = KeyframeError(made.map, made.true_world_from_cam);
  const Rigid3 first = made.map.keyframes.at(0).world_from_cam;
  const RefineOptions options;
  RefineContext context{options};
  GlobalBundle().Process(made.map, context);
  EXPECT_LT(context.report["rms_sigmas_after"].get<double>(), 1.1);
  RefineContext context_of_best{options};
  GlobalBundle().Process(best.map, context_of_best);
  EXPECT_LT(KeyframeError(made.map, made.true_world_from_cam), 0.5 * before);
  for (const auto& [id, keyframe] : best.map.keyframes) {
    EXPECT_LT(
        (made.map.keyframes.at(id).world_from_cam.translation - keyframe.world_from_cam.translation)
            .norm(),
        0.01)
        << id;
  }
  EXPECT_EQ(made.map.keyframes.at(0).world_from_cam.translation, first.translation);
}

TEST(GlobalBundle, RemovesWrongObservations) {
  SyntheticMap made = Shaken();
  int corrupted = 0;
  for (auto& [id, keyframe] : made.map.keyframes) {
    keyframe.keypoints[10].y += 40;
    ++corrupted;
  }
  const RefineOptions options;
  RefineContext context{options};
  GlobalBundle().Process(made.map, context);
  int left = 0;
  for (const auto& [id, keyframe] : made.map.keyframes) {
    // A landmark that one keyframe alone sees says nothing against it.
    const LandmarkId landmark = keyframe.landmarks[10];
    if (landmark != kNoLandmark) left += CollectObservations(made.map).at(landmark).size() > 1;
  }
  EXPECT_LE(left, 2) << "of " << corrupted;
  EXPECT_GE(context.report["outliers"].get<int>(), 10);
  for (const auto& [id, keyframe] : made.map.keyframes) {
    for (const LandmarkId landmark : keyframe.landmarks) {
      EXPECT_TRUE(landmark == kNoLandmark || made.map.landmarks.contains(landmark));
    }
  }
}

// A line that three keyframes see exactly, in both images, begins beside its place.
TEST(GlobalBundle, LinesFindTheirPlace) {
  SyntheticMap made = DriftingMap(0);
  const StereoCamera& stereo = made.map.calibration.stereo;
  const Rigid3& middle = made.map.keyframes.at(2).world_from_cam;
  const SpaceSegment truth{middle * Eigen::Vector3d(-0.4, -0.3, 4),
                           middle * Eigen::Vector3d(0.5, 0.4, 4.5)};
  const auto project = [&](const Rigid3& cam_from_world, double shift) {
    LineSegment line{0, 0, 0, 0, 1};
    const Eigen::Vector3d a = cam_from_world * truth.start, b = cam_from_world * truth.end;
    const Eigen::Vector3d side(shift, 0, 0);
    const Eigen::Vector2d p = stereo.camera.Project(a - side), q = stereo.camera.Project(b - side);
    line.x1 = static_cast<float>(p.x());
    line.y1 = static_cast<float>(p.y());
    line.x2 = static_cast<float>(q.x());
    line.y2 = static_cast<float>(q.y());
    return line;
  };
  for (KeyframeId id = 0; id < 3; ++id) {
    Keyframe& keyframe = made.map.keyframes.at(id);
    const Rigid3 cam_from_world = keyframe.world_from_cam.Inverse();
    keyframe.lines = {project(cam_from_world, 0)};
    keyframe.right_lines = {project(cam_from_world, stereo.baseline)};
    keyframe.line_landmarks = {7};
  }
  const Eigen::Vector3d beside(0.05, -0.03, 0.04);
  made.map.line_landmarks[7] = {7, {truth.start + beside, truth.end - beside}, 0};
  const RefineOptions options;
  RefineContext context{options};
  GlobalBundle().Process(made.map, context);
  EXPECT_EQ(context.report["lines"], 1);
  EXPECT_EQ(context.report["line_outliers"], 0);
  const PluckerLine line = made.map.line_landmarks.at(7).line_in_world();
  // The poses of keyframes 1 and 2 have errors of their own.
  EXPECT_LT(line.Distance(truth.start), 0.035);
  EXPECT_LT(line.Distance(truth.end), 0.035);
}

TEST(GlobalBundle, RepeatsBitByBit) {
  SyntheticMap a = Shaken(), b = Shaken();
  const RefineOptions options;
  RefineContext context_a{options}, context_b{options};
  GlobalBundle().Process(a.map, context_a);
  GlobalBundle().Process(b.map, context_b);
  for (const auto& [id, keyframe] : a.map.keyframes) {
    EXPECT_EQ(keyframe.world_from_cam.translation,
              b.map.keyframes.at(id).world_from_cam.translation);
  }
  for (const auto& [id, landmark] : a.map.landmarks) {
    EXPECT_EQ(landmark.point_in_world, b.map.landmarks.at(id).point_in_world);
  }
}

TEST(GlobalBundle, DoesNothingWhenNothingIsShared) {
  Map map;
  const RefineOptions options;
  RefineContext context{options};
  GlobalBundle().Process(map, context);
  EXPECT_TRUE(context.report.contains("skipped"));
}

}  // namespace
}  // namespace airslam
