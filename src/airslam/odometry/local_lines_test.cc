// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/local_lines.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace airslam {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

const StereoCamera kStereo{{450, 455, 320, 240, 640, 480}, 0.12};

class LocalLinesTest : public ::testing::Test {
 protected:
  LocalLinesTest() { map_.calibration.stereo = kStereo; }

  // A keyframe at x = 0.1 * id that sees the stretch [low, high] of the upright line 4 m ahead at
  // x = 0.5, as its only line.
  KeyframeId Add(double low, double high, LandmarkId landmark) {
    const auto id = static_cast<KeyframeId>(map_.keyframes.size());
    Keyframe keyframe;
    keyframe.id = id;
    keyframe.world_from_cam.translation.x() = 0.1 * id;
    const Rigid3 cam_from_world = keyframe.world_from_cam.Inverse();
    const Eigen::Vector2f start =
        kStereo.camera.Project(cam_from_world * Eigen::Vector3d(0.5, low, 4)).cast<float>();
    const Eigen::Vector2f end =
        kStereo.camera.Project(cam_from_world * Eigen::Vector3d(0.5, high, 4)).cast<float>();
    keyframe.lines = {{start.x(), start.y(), end.x(), end.y(), 1}};
    keyframe.right_lines = {kNoLine};
    keyframe.line_landmarks = {landmark};
    lines_.AddKeyframe(keyframe);
    map_.keyframes[id] = keyframe;
    window_.push_back(id);
    return id;
  }

  BundleJob Job() const {
    BundleJob job;
    std::map<KeyframeId, int> pose_of;
    for (const auto& [id, keyframe] : map_.keyframes) {
      pose_of[id] = static_cast<int>(job.keyframes.size());
      job.keyframes.push_back(id);
      job.problem.world_from_cam.push_back(keyframe.world_from_cam);
    }
    lines_.AddTo(window_, pose_of, job);
    job.summary.line_outlier.assign(job.line_observations.size(), false);
    return job;
  }

  MapWriter::Update Apply(const BundleJob& job, const Rigid3& move = {}) {
    std::map<KeyframeId, Rigid3> moves;
    for (KeyframeId id : job.keyframes) moves[id] = move;
    MapWriter::Update update;
    lines_.Apply(job, moves, update);
    return update;
  }

  LineOptions options_{.pixel_sigma = 0.5, .patience = 2};
  Map map_;
  LocalLines lines_{options_, map_};
  std::vector<KeyframeId> window_;
  const SpaceSegment ends_{{0.5, -0.2, 4}, {0.5, 0.2, 4}};
};

TEST_F(LocalLinesTest, ALineThatTwoKeyframesSeeIsAdjustedAndOneAloneGoesAlong) {
  const LandmarkId shared = lines_.Add(ends_, 0);
  Add(-0.2, 0.2, shared);
  Add(-0.2, 0.2, shared);
  const LandmarkId alone = lines_.Add(ends_, 2);
  Add(-0.2, 0.2, alone);
  const BundleJob job = Job();
  EXPECT_THAT(job.line_landmarks, ElementsAre(shared));
  ASSERT_EQ(job.problem.line_observations.size(), 2u);
  EXPECT_EQ(job.problem.line_observations[1].pose, 1);
  EXPECT_FALSE(job.problem.line_observations[1].seen.right);
  ASSERT_EQ(job.carried_lines.size(), 1u);
  EXPECT_EQ(job.carried_lines[0], std::pair(alone, KeyframeId{2}));
  const MapWriter::Update update = Apply(job, Rigid3({1, 0, 0, 0}, {0, 0, 1}));
  EXPECT_NEAR(map_.line_landmarks.at(alone).ends_in_world.start.z(), 5, 1e-12);
  EXPECT_NEAR(map_.line_landmarks.at(shared).ends_in_world.start.z(), 4, 1e-6);
  EXPECT_EQ(update.line_landmarks.size(), 2u);
  EXPECT_THAT(update.removed_line_landmarks, IsEmpty());
}

TEST_F(LocalLinesTest, TheEndsAreTheOutermostThatWereObserved) {
  const LandmarkId line = lines_.Add(ends_, 0);
  Add(-0.3, 0.1, line);
  Add(-0.1, 0.6, line);
  Apply(Job());
  const SpaceSegment& ends = map_.line_landmarks.at(line).ends_in_world;
  EXPECT_NEAR(std::min(ends.start.y(), ends.end.y()), -0.3, 1e-4);
  EXPECT_NEAR(std::max(ends.start.y(), ends.end.y()), 0.6, 1e-4);
  EXPECT_NEAR(ends.start.x(), 0.5, 1e-4);
}

TEST_F(LocalLinesTest, OutliersAreRemovedAndLinesThatNobodySees) {
  const LandmarkId line = lines_.Add(ends_, 0);
  for (int i = 0; i < 3; ++i) Add(-0.2, 0.2, line);
  BundleJob job = Job();
  job.summary.line_outlier[1] = true;
  MapWriter::Update update = Apply(job);
  EXPECT_EQ(map_.keyframes.at(1).line_landmarks[0], kNoLandmark);
  EXPECT_EQ(lines_.observations(line).size(), 2u);
  ASSERT_EQ(update.keyframe_line_landmarks.size(), 1u);
  EXPECT_EQ(update.keyframe_line_landmarks[0].first, 1);
  job = Job();
  job.summary.line_outlier.assign(2, true);
  update = Apply(job);
  EXPECT_THAT(update.removed_line_landmarks, ElementsAre(line));
  EXPECT_TRUE(map_.line_landmarks.empty());
  EXPECT_EQ(map_.keyframes.at(0).line_landmarks[0], kNoLandmark);
}

TEST_F(LocalLinesTest, ALineThatOneKeyframeSawIsForgottenAfterAWhile) {
  const LandmarkId line = lines_.Add(ends_, 0);
  Add(-0.2, 0.2, line);
  Add(-0.2, 0.2, kNoLandmark);
  EXPECT_THAT(Apply(Job()).removed_line_landmarks, IsEmpty());
  Add(-0.2, 0.2, kNoLandmark);
  const MapWriter::Update update = Apply(Job());
  EXPECT_THAT(update.removed_line_landmarks, ElementsAre(line));
  ASSERT_EQ(update.keyframe_line_landmarks.size(), 1u);
  EXPECT_THAT(update.keyframe_line_landmarks[0].second, ElementsAre(kNoLandmark));
}

TEST_F(LocalLinesTest, InTheEndNoLineWaitsForMoreKeyframes) {
  const LandmarkId known = lines_.Add(ends_, 0);
  for (int i = 0; i < 3; ++i) Add(-0.2, 0.2, known);
  const LandmarkId waiting = lines_.Add(ends_, 3);
  Add(-0.2, 0.2, waiting);
  EXPECT_THAT(Apply(Job()).removed_line_landmarks, IsEmpty());
  MapWriter::Update update;
  lines_.Settle(update);
  EXPECT_THAT(update.removed_line_landmarks, ElementsAre(waiting));
  ASSERT_EQ(update.keyframe_line_landmarks.size(), 1u);
  EXPECT_EQ(update.keyframe_line_landmarks[0].first, 3);
  EXPECT_TRUE(map_.line_landmarks.contains(known));
}

TEST_F(LocalLinesTest, ALineWhoseDepthStaysOpenIsForgotten) {
  // Seen from 0 and 0.1 m, 4 m away, its depth is known to 0.5 px / 11 px; at the same place, not.
  const LandmarkId line = lines_.Add(ends_, 0);
  for (int i = 0; i < 2; ++i) Add(-0.2, 0.2, line);
  Add(-0.2, 0.2, kNoLandmark);
  EXPECT_THAT(Apply(Job()).removed_line_landmarks, IsEmpty());
  map_.keyframes.at(1).world_from_cam = map_.keyframes.at(0).world_from_cam;
  map_.keyframes.at(1).lines = map_.keyframes.at(0).lines;
  EXPECT_THAT(Apply(Job()).removed_line_landmarks, ElementsAre(line));
}

TEST_F(LocalLinesTest, ImplausibleLinesAreForgotten) {
  options_.max_depth = 3;  // of new ones
  LocalLines strict(options_, map_);
  const LandmarkId line = strict.Add(ends_, 0);
  Add(-0.2, 0.2, kNoLandmark);
  Add(-0.2, 0.2, kNoLandmark);
  strict.AddObservation(line, {0, 0});
  strict.AddObservation(line, {1, 0});
  BundleJob job;
  job.keyframes = {0, 1};
  strict.AddTo(window_, {{0, 0}, {1, 1}}, job);
  job.summary.line_outlier.assign(2, false);
  MapWriter::Update update;
  strict.Apply(job, {{0, Rigid3()}, {1, Rigid3()}}, update);
  EXPECT_THAT(update.removed_line_landmarks, ElementsAre(line));
}

}  // namespace
}  // namespace airslam
