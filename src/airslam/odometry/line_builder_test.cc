// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/line_builder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "airslam/geometry/so3.h"

namespace airslam {
namespace {

const StereoCamera kStereo{{450, 455, 320, 240, 640, 480}, 0.12};

// Three edges, 3 to 5 metres ahead, each with four points on it; the last one is level, so that the
// two planes of a stereo pair say nothing of its depth.
const std::vector<SpaceSegment> kEdges = {{{-0.8, -0.6, 3}, {-0.7, 0.7, 3.3}},
                                          {{0.6, -0.7, 4}, {1.0, 0.6, 5}},
                                          {{-0.6, 0.4, 4}, {0.7, 0.4, 4}}};
constexpr int kPointsAnEdge = 4;

class LineBuilderTest : public ::testing::Test {
 protected:
  static Eigen::Vector3d PointOn(const SpaceSegment& edge, int k) {
    return edge.start + (k + 0.5) / kPointsAnEdge * (edge.end - edge.start);
  }

  static LineSegment Image(const SpaceSegment& edge, const Rigid3& cam_from_world) {
    const Eigen::Vector2f a = kStereo.camera.Project(cam_from_world * edge.start).cast<float>();
    const Eigen::Vector2f b = kStereo.camera.Project(cam_from_world * edge.end).cast<float>();
    return {a.x(), a.y(), b.x(), b.y(), 1};
  }

  static Detections Lines(const Rigid3& cam_from_world) {
    Detections detections;
    for (const SpaceSegment& edge : kEdges) {
      detections.lines.push_back(Image(edge, cam_from_world));
    }
    detections.junctions.resize(6);
    detections.junction_descriptors = DescriptorMatrix::Ones(6, 4);
    return detections;
  }

  // A keyframe that sees all of it; with_depth: its points have right matches.
  Keyframe See(const Rigid3& world_from_cam, bool with_right = true) {
    const Rigid3 left = world_from_cam.Inverse();
    if (points_.empty()) {
      for (const SpaceSegment& edge : kEdges) {
        for (int k = 0; k < kPointsAnEdge; ++k)
          points_.push_back(map_.AddLandmark(PointOn(edge, k)));
      }
    }
    Keyframe keyframe;
    keyframe.id = map_.next_keyframe_id();
    keyframe.world_from_cam = world_from_cam;
    keyframe.landmarks = points_;
    for (LandmarkId id : points_) {
      const Eigen::Vector3d p = left * map_.map().landmarks.at(id).point_in_world;
      const Eigen::Vector2f pixel = kStereo.camera.Project(p).cast<float>();
      keyframe.keypoints.push_back({pixel.x(), pixel.y(), 1});
      keyframe.right_x.push_back(
          with_right ? pixel.x() - static_cast<float>(kStereo.Disparity(p.z())) : -1);
    }
    builder_.SetLines(Lines(left), Lines(RightFromLeft(kStereo) * left), keyframe);
    return keyframe;
  }

  static double ErrorOf(const LineLandmark& line, const SpaceSegment& edge) {
    return std::max(line.line_in_world().Distance(edge.start),
                    line.line_in_world().Distance(edge.end));
  }

  LineOptions options_;
  LocalMap map_{{kStereo, {}, false}, {}, 0.4, options_};
  LineBuilder builder_{options_, map_};
  std::vector<LandmarkId> points_;
};

TEST_F(LineBuilderTest, LinesAreMatchedWithTheRightImageAndTriangulatedBothWays) {
  Keyframe keyframe = See({});
  ASSERT_EQ(keyframe.lines.size(), kEdges.size());
  EXPECT_EQ(keyframe.junctions.size(), 6u);
  for (const LineSegment& right : keyframe.right_lines) EXPECT_GE(right.score, 0);
  const LineChanges changes = builder_.FindLandmarks(keyframe);
  ASSERT_EQ(changes.added.size(), kEdges.size());
  EXPECT_THAT(changes.observed, ::testing::IsEmpty());
  for (std::size_t i = 0; i < kEdges.size(); ++i) {
    const LineLandmark& line = map_.map().line_landmarks.at(keyframe.line_landmarks[i]);
    EXPECT_LT(ErrorOf(line, kEdges[i]), 0.002) << i;
    EXPECT_NEAR((line.ends_in_world.end - line.ends_in_world.start).norm(),
                (kEdges[i].end - kEdges[i].start).norm(), 0.01);
    EXPECT_EQ(line.first_seen_by, 0);
  }
}

TEST_F(LineBuilderTest, TheNextKeyframeSeesTheSameLines) {
  Keyframe first = See({});
  builder_.FindLandmarks(first);
  const std::vector<LandmarkId> lines = first.line_landmarks;
  map_.AddKeyframe(std::move(first), {});
  Keyframe second = See({ExpSO3({0.01, 0.03, 0}), {0.2, 0.05, 0.1}});
  EXPECT_THAT(builder_.FindLandmarks(second).added, ::testing::IsEmpty());
  EXPECT_EQ(second.line_landmarks, lines);
  map_.AddKeyframe(std::move(second), {});
  EXPECT_EQ(map_.lines().observations(lines[0]).size(), 2u);
}

TEST_F(LineBuilderTest, LinesAreSoughtWhereTheMapHasThem) {
  Keyframe first = See({});
  builder_.FindLandmarks(first);
  const std::vector<LandmarkId> lines = first.line_landmarks;
  map_.AddKeyframe(std::move(first), {});
  Keyframe second = See({ExpSO3({0.01, 0.03, 0}), {0.2, 0.05, 0.1}});
  for (LandmarkId& id : second.landmarks) id = kNoLandmark;  // no points to match them by
  // Two lines in almost the same place: which of them it is cannot be said.
  LineSegment rival = second.lines[1];
  rival.x1 += 1;
  rival.x2 += 1;
  second.lines.push_back(rival);
  second.lines[1].x1 -= 1;
  second.lines[1].x2 -= 1;
  second.right_lines.assign(4, kNoLine);
  second.line_landmarks.assign(4, kNoLandmark);
  EXPECT_THAT(builder_.FindLandmarks(second).added, ::testing::IsEmpty());
  EXPECT_THAT(second.line_landmarks,
              ::testing::ElementsAre(lines[0], kNoLandmark, lines[2], kNoLandmark));
}

TEST_F(LineBuilderTest, ALineThatLiesElsewhereIsAnotherOne) {
  Keyframe first = See({});
  builder_.FindLandmarks(first);
  const std::vector<LandmarkId> lines = first.line_landmarks;
  map_.AddKeyframe(std::move(first), {});
  map_.map().line_landmarks.at(lines[1]).ends_in_world.start.x() += 0.3;
  Keyframe second = See({ExpSO3({0.01, 0.03, 0}), {0.2, 0.05, 0.1}});
  const LineChanges changes = builder_.FindLandmarks(second);
  EXPECT_EQ(second.line_landmarks[0], lines[0]);
  EXPECT_EQ(second.line_landmarks[2], lines[2]);
  ASSERT_EQ(changes.added.size(), 1u);
  EXPECT_EQ(second.line_landmarks[1], changes.added[0]);
}

TEST_F(LineBuilderTest, TwoKeyframesTriangulateWhatNoneOfThemCouldAlone) {
  Keyframe first = See({}, false);
  // Points without landmarks give no line either.
  for (LandmarkId& id : first.landmarks) id = kNoLandmark;
  EXPECT_THAT(builder_.FindLandmarks(first).added, ::testing::IsEmpty());
  first.landmarks = points_;
  map_.AddKeyframe(std::move(first), {});
  Keyframe second = See({ExpSO3({0, 0.05, 0}), {0.4, 0.3, 0}}, false);
  const LineChanges changes = builder_.FindLandmarks(second);
  ASSERT_EQ(changes.added.size(), kEdges.size());
  EXPECT_THAT(changes.observed, ::testing::ElementsAre(0));
  for (std::size_t i = 0; i < kEdges.size(); ++i) {
    const LineLandmark& line = map_.map().line_landmarks.at(second.line_landmarks[i]);
    EXPECT_LT(ErrorOf(line, kEdges[i]), 0.002) << i;
    EXPECT_EQ(line.first_seen_by, 0);
    EXPECT_EQ(map_.map().keyframes.at(0).line_landmarks[i], line.id);
  }
}

}  // namespace
}  // namespace airslam
