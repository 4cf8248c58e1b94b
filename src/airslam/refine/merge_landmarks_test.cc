// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/refine/merge_landmarks.h"

#include <gtest/gtest.h>

#include "airslam/map/test_scene.h"
#include "airslam/refine/test_refine.h"

namespace airslam {
namespace {

// Keyframe 2 of the scene sees the twelve points as landmarks 100 to 111 of its own.
Map SceneSeenAgain() {
  Map map = TestScene();
  for (LandmarkId& id : map.keyframes.at(2).landmarks) {
    map.landmarks[id + 100] = {id + 100, map.landmarks.at(id).point_in_world, 2};
    id += 100;
  }
  return map;
}

Loop LoopOf(std::vector<std::pair<int, int>> keypoints) {
  Loop loop;
  loop.earlier = 0;
  loop.later = 2;
  loop.keypoints = std::move(keypoints);
  return loop;
}

class MergeLandmarksTest : public ::testing::Test {
 protected:
  void Merge() { MergeLandmarks().Process(map_, context_); }
  Map map_ = SceneSeenAgain();
  RefineOptions options_;
  RefineContext context_{options_};
};

TEST_F(MergeLandmarksTest, TheOlderPointStaysAndAllNameIt) {
  map_.keyframes.at(1).landmarks[3] = 103;  // somebody else sees the newer one
  context_.loops = {LoopOf({{3, 3}, {5, 5}})};
  Merge();
  EXPECT_EQ(context_.report["points_merged"], 2);
  EXPECT_FALSE(map_.landmarks.contains(103));
  for (KeyframeId id : {0, 1, 2}) {
    EXPECT_EQ(map_.keyframes.at(id).landmarks[3], 3) << id;
    EXPECT_EQ(map_.keyframes.at(id).landmarks[5], 5) << id;
  }
  EXPECT_EQ(map_.keyframes.at(2).landmarks[4], 104) << "what no loop joins stays apart";
}

TEST_F(MergeLandmarksTest, AKeypointWithoutLandmarkGetsTheOthers) {
  map_.keyframes.at(2).landmarks[6] = kNoLandmark;
  map_.keyframes.at(0).landmarks[7] = kNoLandmark;
  map_.landmarks.erase(106);
  context_.loops = {LoopOf({{6, 6}, {7, 7}})};
  Merge();
  EXPECT_EQ(context_.report["observations_added"], 2);
  EXPECT_EQ(map_.keyframes.at(2).landmarks[6], 6);
  EXPECT_EQ(map_.keyframes.at(0).landmarks[7], 107);
}

TEST_F(MergeLandmarksTest, NoKeyframeSeesALandmarkTwice) {
  context_.loops = {LoopOf({{3, 3}, {3, 4}})};  // 103 and 104 would both be 3
  Merge();
  const std::vector<LandmarkId>& ids = map_.keyframes.at(2).landmarks;
  EXPECT_EQ(std::count(ids.begin(), ids.end(), 3), 1);
  EXPECT_EQ(ids[3], 3) << "the first keypoint keeps it";
  EXPECT_EQ(ids[4], kNoLandmark);
}

TEST_F(MergeLandmarksTest, ChainsOfLoopsMakeOnePoint) {
  Loop second = LoopOf({{5, 3}});
  second.earlier = 1;
  context_.loops = {LoopOf({{3, 3}}), second};  // 3 = 103 = 5
  Merge();
  EXPECT_EQ(map_.keyframes.at(2).landmarks[3], 3);
  EXPECT_FALSE(map_.landmarks.contains(5));
}

// Four points in a row of the image, with a line through them that both keyframes see as their own.
void AddLine(Map& map, LandmarkId id, KeyframeId keyframe_id) {
  Keyframe& keyframe = map.keyframes.at(keyframe_id);
  const Keypoint &a = keyframe.keypoints[0], &b = keyframe.keypoints[3];
  keyframe.lines.push_back({a.x - 1, a.y, b.x + 1, b.y, 1});
  keyframe.right_lines.push_back({0, 0, 0, 0, -1});
  keyframe.line_landmarks.push_back(id);
  map.line_landmarks[id] = {id, {{0, 0, 5}, {1, 0, 5}}, keyframe_id};
}

TEST_F(MergeLandmarksTest, LinesThatShareMoreThanThreePointsAreOne) {
  AddLine(map_, 4, 0);
  AddLine(map_, 9, 2);
  context_.loops = {LoopOf({{0, 0}, {1, 1}, {2, 2}, {3, 3}})};
  Merge();
  EXPECT_EQ(context_.report["lines_merged"], 1);
  EXPECT_EQ(map_.keyframes.at(2).line_landmarks[0], 4);
  EXPECT_FALSE(map_.line_landmarks.contains(9));
}

TEST_F(MergeLandmarksTest, LinesThatShareThreePointsStay) {
  AddLine(map_, 4, 0);
  AddLine(map_, 9, 2);
  context_.loops = {LoopOf({{0, 0}, {1, 1}, {2, 2}})};
  Merge();
  EXPECT_EQ(context_.report["lines_merged"], 0);
}

TEST_F(MergeLandmarksTest, LinesSeenSideBySideStayApart) {
  AddLine(map_, 4, 0);
  AddLine(map_, 5, 0);
  Merge();
  EXPECT_EQ(context_.report["lines_merged"], 0);
  EXPECT_EQ(map_.line_landmarks.size(), 2u);
}

}  // namespace
}  // namespace airslam
