// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/local_map.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace airslam {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr int kKeypoints = 4;

class LocalMapTest : public ::testing::Test {
 protected:
  // A keyframe that sees `landmarks`, one a keypoint.
  void Add(std::vector<LandmarkId> landmarks, int component = 0) {
    Keyframe keyframe;
    keyframe.id = map_.next_keyframe_id();
    keyframe.component = component;
    keyframe.world_from_cam.translation.x() = keyframe.id;
    keyframe.keypoints.resize(kKeypoints);
    keyframe.right_x.assign(kKeypoints, -1);
    landmarks.resize(kKeypoints, kNoLandmark);
    keyframe.landmarks = landmarks;
    map_.AddKeyframe(std::move(keyframe), {});
  }

  // The fixed and the free keyframes of a job.
  static std::vector<KeyframeId> Keyframes(const BundleJob& job, bool fixed) {
    std::vector<KeyframeId> ids;
    for (std::size_t i = 0; i < job.keyframes.size(); ++i) {
      if (job.problem.pose_fixed[i] == fixed) ids.push_back(job.keyframes[i]);
    }
    return ids;
  }

  // As solving it would leave it: nothing moved, no outlier.
  BundleJob SolvedJob() const {
    BundleJob job = map_.MakeBundleJob();
    job.summary.outlier.assign(job.observations.size(), false);
    return job;
  }

  std::vector<KeyframeId> Window() const { return {map_.window().begin(), map_.window().end()}; }

  LocalMap map_{{}, {.window = 3, .max_fixed = 2, .lag_frames = 1}, 0.4};
};

TEST_F(LocalMapTest, TheWindowHoldsTheLatestKeyframesOfTheComponent) {
  EXPECT_TRUE(map_.empty());
  for (int i = 0; i < 5; ++i) Add({});
  EXPECT_THAT(Window(), ElementsAre(2, 3, 4));
  EXPECT_EQ(map_.last().id, 4);
  Add({}, 1);
  EXPECT_THAT(Window(), ElementsAre(5));
  EXPECT_EQ(map_.map().keyframes.size(), 6u);
}

TEST_F(LocalMapTest, ALandmarkIsDefinedByItsFirstPatchThatIsStillThere) {
  const LandmarkId landmark = map_.AddLandmark({0, 0, 5});
  Add({landmark});
  Add({kNoLandmark, landmark});
  EXPECT_EQ(map_.Source(landmark).keyframe, 0);
  map_.SetSource(landmark, {1, 1});
  EXPECT_EQ(map_.Source(landmark).keyframe, 1);
  EXPECT_EQ(map_.Source(landmark).index, 1);
  for (int i = 0; i < 2; ++i) Add({kNoLandmark, kNoLandmark, landmark});
  Add({});  // keyframe 1 leaves the window: the next one takes over
  EXPECT_EQ(map_.Source(landmark).keyframe, 2);
  for (int i = 0; i < 3; ++i) Add({});
  EXPECT_LT(map_.Source(landmark).keyframe, 0);
}

TEST_F(LocalMapTest, ABundleHoldsTheFirstKeyframeUntilOlderOnesHoldTheWindow) {
  const LandmarkId landmark = map_.AddLandmark({0, 0, 5});
  Add({landmark});
  Add({landmark});
  EXPECT_THAT(Keyframes(map_.MakeBundleJob(), true), ElementsAre(0));
  EXPECT_THAT(Keyframes(map_.MakeBundleJob(), false), ElementsAre(1));
  for (int i = 2; i < 7; ++i) Add({landmark});
  // Four older keyframes see the landmark: max_fixed of them, the latest.
  EXPECT_THAT(Keyframes(map_.MakeBundleJob(), true), ElementsAre(2, 3));
  EXPECT_THAT(Keyframes(map_.MakeBundleJob(), false), ElementsAre(4, 5, 6));
}

TEST_F(LocalMapTest, ABundleHoldsWhatTheWindowSees) {
  const LandmarkId old = map_.AddLandmark({1, 0, 5});
  const LandmarkId shared = map_.AddLandmark({2, 0, 5});
  Add({old, shared});
  for (int i = 0; i < 3; ++i) Add({kNoLandmark, kNoLandmark, shared});
  const BundleJob job = map_.MakeBundleJob();
  EXPECT_THAT(job.landmarks, ElementsAre(shared));
  ASSERT_EQ(job.observations.size(), 4u);
  EXPECT_EQ(job.problem.observations.size(), 4u);
  EXPECT_EQ(job.observations[0].index, 1);
  EXPECT_EQ(job.observations[3].index, 2);
  EXPECT_EQ(job.problem.observations[0].seen.sigma, 0.4);
  EXPECT_EQ(job.problem.points_in_world[0], Eigen::Vector3d(2, 0, 5));
}

TEST_F(LocalMapTest, ApplyingABundleMovesWhatWasFree) {
  const LandmarkId landmark = map_.AddLandmark({0, 0, 5});
  Add({landmark});
  Add({landmark});
  BundleJob job = SolvedJob();
  for (Rigid3& pose : job.problem.world_from_cam) pose.translation.y() = 7;
  job.problem.points_in_world[0] = {0, 0, 6};
  const MapWriter::Update update = map_.Apply(job);
  EXPECT_EQ(map_.map().keyframes.at(0).world_from_cam.translation.y(), 0);
  EXPECT_EQ(map_.map().keyframes.at(1).world_from_cam.translation.y(), 7);
  EXPECT_EQ(map_.map().landmarks.at(landmark).point_in_world.z(), 6);
  ASSERT_EQ(update.world_from_cam.size(), 1u);
  EXPECT_EQ(update.world_from_cam[0].first, 1);
  ASSERT_EQ(update.landmarks.size(), 1u);
  EXPECT_EQ(update.landmarks[0].point_in_world.z(), 6);
  EXPECT_THAT(update.keyframe_landmarks, IsEmpty());
  EXPECT_THAT(update.removed_landmarks, IsEmpty());
}

TEST_F(LocalMapTest, OutliersAreRemovedAndLandmarksThatNobodySees) {
  const LandmarkId kept = map_.AddLandmark({0, 0, 5});
  const LandmarkId lost = map_.AddLandmark({1, 0, 5});
  Add({kept, lost});
  Add({kept, lost});
  BundleJob job = SolvedJob();
  for (std::size_t i = 0; i < job.observations.size(); ++i) {
    const FeatureRef& ref = job.observations[i];
    job.summary.outlier[i] = ref.keyframe == 1 || ref.index == 1;
  }
  const MapWriter::Update update = map_.Apply(job);
  EXPECT_THAT(map_.map().keyframes.at(0).landmarks,
              ElementsAre(kept, kNoLandmark, kNoLandmark, kNoLandmark));
  EXPECT_THAT(map_.map().keyframes.at(1).landmarks,
              ElementsAre(kNoLandmark, kNoLandmark, kNoLandmark, kNoLandmark));
  EXPECT_THAT(update.removed_landmarks, ElementsAre(lost));
  EXPECT_FALSE(map_.map().landmarks.contains(lost));
  EXPECT_EQ(map_.observations(kept).size(), 1u);
  ASSERT_EQ(update.keyframe_landmarks.size(), 2u);
  EXPECT_EQ(update.keyframe_landmarks[0].second, map_.map().keyframes.at(0).landmarks);
  ASSERT_EQ(update.landmarks.size(), 1u);
  EXPECT_EQ(update.landmarks[0].id, kept);
}

TEST_F(LocalMapTest, ALandmarkThatOneKeyframeSeesGoesAlongWithIt) {
  const LandmarkId shared = map_.AddLandmark({0, 0, 5});
  Add({shared});
  const LandmarkId alone = map_.AddLandmark({1, 0, 5});
  Add({shared, alone});
  BundleJob job = SolvedJob();
  EXPECT_THAT(job.landmarks, ElementsAre(shared));
  job.problem.world_from_cam[1].translation.y() += 2;
  const Eigen::Vector3d in_cam =
      map_.map().keyframes.at(1).world_from_cam.Inverse() * Eigen::Vector3d(1, 0, 5);
  const MapWriter::Update update = map_.Apply(job);
  const Eigen::Vector3d& moved = map_.map().landmarks.at(alone).point_in_world;
  EXPECT_NEAR(moved.y(), 2, 1e-12);
  EXPECT_NEAR((map_.map().keyframes.at(1).world_from_cam.Inverse() * moved - in_cam).norm(), 0,
              1e-12);
  ASSERT_EQ(update.landmarks.size(), 2u);
  EXPECT_EQ(update.landmarks[1].point_in_world, moved);
}

TEST_F(LocalMapTest, AKeyframeOfTheMapCanSeeALandmarkThatIsAddedLater) {
  Add({});
  const LandmarkId landmark = map_.AddLandmark({0, 0, 5});
  map_.AddObservation(landmark, {0, 3});
  Add({landmark});
  EXPECT_EQ(map_.map().keyframes.at(0).landmarks[3], landmark);
  EXPECT_EQ(map_.map().landmarks.at(landmark).first_seen_by, 0);
  EXPECT_EQ(map_.observations(landmark).size(), 2u);
  EXPECT_EQ(map_.Source(landmark).keyframe, 0);
}

}  // namespace
}  // namespace airslam
