// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/keyframe_builder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>

#include "airslam/sensor/rectification.h"
#include "airslam/testing/synthetic_detector.h"
#include "airslam/testing/synthetic_sequence.h"

namespace airslam {
namespace {

// A frame of the synthetic world with its exact pose.
struct Sight {
  ImagePyramid image;
  FrameFeatures features;
  Rigid3 world_from_cam;

  FrameView view() const { return {image, features}; }
};

class KeyframeBuilderTest : public ::testing::Test {
 protected:
  static SyntheticSequenceOptions Options() {
    SyntheticSequenceOptions options;
    options.rig = IdealRig(320, 208);
    options.frames = 6;
    return options;
  }

  Sight See(int index) {
    const cv::Mat left = sequence_.Read(index).left;
    FrameFeatures features(
        left.size(), [this, left] { return detector_.Detect(left, {}, options_.max_keypoints); });
    return {MakePyramid(left), std::move(features),
            sequence_.states()[index].world_from_body * rectifier_.body_from_left()};
  }

  // The exact depth of what a pixel shows.
  double Depth(const Rigid3& world_from_cam, const Eigen::Vector2d& pixel) const {
    const Eigen::Vector3d ray = world_from_cam.rotation * map_.stereo().camera.Unproject(pixel);
    return sequence_.world().Cast(world_from_cam.translation, ray)->distance;
  }

  // Exact right matches for every `every`-th keypoint.
  void SetRight(Keyframe& keyframe, int every) const {
    for (std::size_t i = 0; i < keyframe.keypoints.size(); i += every) {
      const Keypoint& k = keyframe.keypoints[i];
      const double depth = Depth(keyframe.world_from_cam, {k.x, k.y});
      keyframe.right_x[i] = static_cast<float>(k.x - map_.stereo().Disparity(depth));
    }
  }

  // The first keyframe of the map, with landmarks at every `every`-th keypoint.
  void Start(int every) {
    const Sight sight = See(0);
    Keyframe keyframe = builder_.FromDetections(sight.view(), 1, 0, sight.world_from_cam).keyframe;
    SetRight(keyframe, every);
    builder_.AddStereoLandmarks(keyframe);
    map_.AddKeyframe(std::move(keyframe), sight.image);
  }

  KeyframeDraft Follow(const Sight& sight) {
    const auto tracked =
        tracker_.Track(sight.view(), map_.last(), {sight.world_from_cam, 0.1, 0.1});
    if (!tracked) throw std::runtime_error("the frame was not tracked");
    return builder_.FromTracked(sight.view(), 2, *tracked);
  }

  OdometryOptions options_;
  SyntheticSequence sequence_{Options()};
  StereoRectifier rectifier_{sequence_.rig()};
  SyntheticDetector detector_;
  SyntheticMatcher matcher_;
  LocalMap map_{{rectifier_.stereo(), rectifier_.body_from_left(), true},
                options_.local_map,
                options_.tracking.pixel_sigma};
  FrameTracker tracker_{options_.tracking, map_, matcher_};
  KeyframeBuilder builder_{options_, tracker_, map_};
};

TEST_F(KeyframeBuilderTest, WhatHasDepthBecomesALandmark) {
  const Sight sight = See(0);
  Keyframe keyframe = builder_.FromDetections(sight.view(), 5, 3, sight.world_from_cam).keyframe;
  EXPECT_EQ(keyframe.id, 0);
  EXPECT_EQ(keyframe.timestamp_ns, 5);
  EXPECT_EQ(keyframe.component, 3);
  EXPECT_THAT(keyframe.landmarks, ::testing::Each(kNoLandmark));
  SetRight(keyframe, 2);
  const std::vector<LandmarkId> added = builder_.AddStereoLandmarks(keyframe);
  EXPECT_GT(added.size(), 40u);
  EXPECT_EQ(added.size(), (keyframe.keypoints.size() + 1) / 2);
  for (std::size_t i = 0; i < keyframe.keypoints.size(); ++i) {
    ASSERT_EQ(keyframe.landmarks[i] != kNoLandmark, i % 2 == 0);
    if (keyframe.landmarks[i] == kNoLandmark) continue;
    const Keypoint& k = keyframe.keypoints[i];
    const double depth = Depth(sight.world_from_cam, {k.x, k.y});
    const Eigen::Vector3d expected =
        sight.world_from_cam * Eigen::Vector3d(depth * map_.stereo().camera.Unproject({k.x, k.y}));
    const Landmark& landmark = map_.map().landmarks.at(keyframe.landmarks[i]);
    EXPECT_LT((landmark.point_in_world - expected).norm(), 1e-3 * depth);
  }
}

TEST_F(KeyframeBuilderTest, ATrackedKeyframeTakesOverTheLandmarksItSees) {
  Start(1);
  const Sight sight = See(2);
  const Keyframe keyframe = Follow(sight).keyframe;
  EXPECT_EQ(keyframe.id, 1);
  EXPECT_EQ(keyframe.landmarks.size(), keyframe.keypoints.size());
  EXPECT_EQ(keyframe.right_x.size(), keyframe.keypoints.size());
  EXPECT_EQ(keyframe.descriptors.rows(), static_cast<int>(keyframe.keypoints.size()));
  std::set<LandmarkId> seen;
  int near = 0;
  for (std::size_t i = 0; i < keyframe.landmarks.size(); ++i) {
    if (keyframe.landmarks[i] == kNoLandmark) continue;
    EXPECT_TRUE(seen.insert(keyframe.landmarks[i]).second) << "seen twice";
    const Eigen::Vector2d expected =
        map_.stereo().camera.Project(sight.world_from_cam.Inverse() *
                                     map_.map().landmarks.at(keyframe.landmarks[i]).point_in_world);
    const Keypoint& k = keyframe.keypoints[i];
    near += (Eigen::Vector2d(k.x, k.y) - expected).norm() < 2;
  }
  EXPECT_GT(seen.size(), 40u);
  EXPECT_GT(near, 0.9 * static_cast<double>(seen.size()));
}

TEST_F(KeyframeBuilderTest, NewLandmarksKeepTheirDistanceFromTrackedOnes) {
  Start(2);
  Keyframe keyframe = Follow(See(2)).keyframe;
  const std::vector<LandmarkId> tracked = keyframe.landmarks;
  SetRight(keyframe, 1);
  EXPECT_GT(builder_.AddStereoLandmarks(keyframe).size(), 10u);
  for (std::size_t i = 0; i < tracked.size(); ++i) {
    if (tracked[i] == kNoLandmark) continue;
    EXPECT_EQ(keyframe.landmarks[i], tracked[i]);
    for (std::size_t j = 0; j < tracked.size(); ++j) {
      if (tracked[j] != kNoLandmark || keyframe.landmarks[j] == kNoLandmark) continue;
      const Keypoint &a = keyframe.keypoints[i], &b = keyframe.keypoints[j];
      EXPECT_GE(std::hypot(a.x - b.x, a.y - b.y), options_.keyframe.min_spacing);
    }
  }
}

TEST_F(KeyframeBuilderTest, WhatTwoKeyframesSeeWithoutDepthIsTriangulated) {
  Start(2);
  const Sight sight = See(5);
  Keyframe keyframe = Follow(sight).keyframe;
  const std::vector<LandmarkId> added = builder_.AddMotionLandmarks(sight.view(), keyframe);
  EXPECT_GT(added.size(), 3u);
  int close = 0;
  for (LandmarkId id : added) {
    ASSERT_EQ(map_.observations(id).size(), 1u);
    EXPECT_EQ(map_.observations(id)[0].keyframe, 0);
    EXPECT_EQ(map_.map().landmarks.at(id).first_seen_by, 0);
    EXPECT_EQ(std::count(keyframe.landmarks.begin(), keyframe.landmarks.end(), id), 1);
    const Eigen::Vector3d point =
        sight.world_from_cam.Inverse() * map_.map().landmarks.at(id).point_in_world;
    const double depth = Depth(sight.world_from_cam, map_.stereo().camera.Project(point));
    close += std::abs(point.z() - depth) < 0.1 * depth;
  }
  EXPECT_GE(close, 0.8 * static_cast<double>(added.size()));
}

}  // namespace
}  // namespace airslam
