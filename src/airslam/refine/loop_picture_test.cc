// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/refine/loop_picture.h"

#include <gtest/gtest.h>

#include "airslam/refine/test_refine.h"

namespace airslam {
namespace {

// Pixels that are much more red than blue and green.
int CountRed(const cv::Mat& picture) {
  int count = 0;
  for (int y = 40; y < picture.rows; ++y) {  // below the legend
    for (int x = 0; x < picture.cols; ++x) {
      const auto& p = picture.at<cv::Vec3b>(y, x);
      count += p[2] > 200 && p[0] < 90 && p[1] < 90;
    }
  }
  return count;
}

TEST(LoopPicture, ShowsLoops) {
  const SyntheticMap made = DriftingMap();
  std::map<KeyframeId, Rigid3> before;
  for (const auto& [id, keyframe] : made.map.keyframes) before[id] = keyframe.world_from_cam;
  EXPECT_EQ(CountRed(DrawLoops(made.map, before, {})), 0);
  Loop loop;
  loop.earlier = 0;
  loop.later = 10;  // across the hall
  EXPECT_GT(CountRed(DrawLoops(made.map, before, {loop})), 100);
}

TEST(LoopPicture, AcceptsMapsWithoutExtent) {
  EXPECT_EQ(DrawLoops(Map(), {}, {}).cols, 1000);
  Map map;
  map.keyframes[0].id = 0;
  EXPECT_EQ(DrawLoops(map, {{0, Rigid3()}}, {}).rows, 1000);
}

}  // namespace
}  // namespace airslam
