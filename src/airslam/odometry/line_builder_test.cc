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

  // A keyframe that sees the points on all edges; with_right: in the right image, too.
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
    return keyframe;
  }

  static KeyframeLines LinesOf(const Keyframe& keyframe, bool with_right = true) {
    const Rigid3 left = keyframe.world_from_cam.Inverse();
    KeyframeLines found{keyframe.id, Lines(left), Lines(RightFromLeft(kStereo) * left).lines};
    if (!with_right) found.right.assign(found.right.size(), kNoLine);
    return found;
  }

  // Makes it the latest keyframe of the map, and gives it its lines.
  LineChanges Add(Keyframe keyframe, KeyframeLines lines) {
    map_.AddKeyframe(std::move(keyframe), {});
    return builder_.AddLines(std::move(lines));
  }
  LineChanges Add(const Keyframe& keyframe) { return Add(keyframe, LinesOf(keyframe)); }

  static double ErrorOf(const LineLandmark& line, const SpaceSegment& edge) {
    return std::max(line.line_in_world().Distance(edge.start),
                    line.line_in_world().Distance(edge.end));
  }

  LineOptions options_;
  LocalMap map_{{kStereo, {}, false}, {}, 0.4, options_};
  LineBuilder builder_{options_, map_};
  std::vector<LandmarkId> points_;
};

TEST_F(LineBuilderTest, LinesAreTriangulatedBothWays) {
  const LineChanges changes = Add(See({}));
  const Keyframe& keyframe = map_.last();
  ASSERT_EQ(keyframe.lines.size(), kEdges.size());
  EXPECT_EQ(keyframe.right_lines.size(), kEdges.size());
  EXPECT_EQ(keyframe.junctions.size(), 6u);
  EXPECT_EQ(keyframe.junction_descriptors.rows(), 6);
  EXPECT_EQ(changes.keyframe, 0);
  ASSERT_EQ(changes.added.size(), kEdges.size());
  EXPECT_THAT(changes.observed, ::testing::IsEmpty());
  for (std::size_t i = 0; i < kEdges.size(); ++i) {
    const LineLandmark& line = map_.map().line_landmarks.at(keyframe.line_landmarks[i]);
    EXPECT_LT(ErrorOf(line, kEdges[i]), 0.002) << i;
    EXPECT_NEAR((line.ends_in_world.end - line.ends_in_world.start).norm(),
                (kEdges[i].end - kEdges[i].start).norm(), 0.01);
    EXPECT_EQ(line.first_seen_by, 0);
    EXPECT_EQ(map_.lines().observations(line.id).size(), 1u);
  }
}

TEST_F(LineBuilderTest, TheNextKeyframeSeesTheSameLines) {
  Add(See({}));
  const std::vector<LandmarkId> lines = map_.last().line_landmarks;
  EXPECT_THAT(Add(See({ExpSO3({0.01, 0.03, 0}), {0.2, 0.05, 0.1}})).added, ::testing::IsEmpty());
  EXPECT_EQ(map_.last().line_landmarks, lines);
  EXPECT_EQ(map_.lines().observations(lines[0]).size(), 2u);
}

TEST_F(LineBuilderTest, LinesAreSoughtWhereTheMapHasThem) {
  Add(See({}));
  const std::vector<LandmarkId> lines = map_.last().line_landmarks;
  Keyframe second = See({ExpSO3({0.01, 0.03, 0}), {0.2, 0.05, 0.1}});
  for (LandmarkId& id : second.landmarks) id = kNoLandmark;  // no points to match them by
  // Two lines in almost the same place: which of them it is cannot be said.
  KeyframeLines found = LinesOf(second);
  LineSegment rival = found.left.lines[1];
  rival.x1 += 1;
  rival.x2 += 1;
  found.left.lines.push_back(rival);
  found.left.lines[1].x1 -= 1;
  found.left.lines[1].x2 -= 1;
  found.right.assign(4, kNoLine);
  EXPECT_THAT(Add(second, found).added, ::testing::IsEmpty());
  EXPECT_THAT(map_.last().line_landmarks,
              ::testing::ElementsAre(lines[0], kNoLandmark, lines[2], kNoLandmark));
}

TEST_F(LineBuilderTest, ALineThatLiesElsewhereIsAnotherOne) {
  Add(See({}));
  const std::vector<LandmarkId> lines = map_.last().line_landmarks;
  map_.map().line_landmarks.at(lines[1]).ends_in_world.start.x() += 0.3;
  const LineChanges changes = Add(See({ExpSO3({0.01, 0.03, 0}), {0.2, 0.05, 0.1}}));
  const Keyframe& second = map_.last();
  EXPECT_EQ(second.line_landmarks[0], lines[0]);
  EXPECT_EQ(second.line_landmarks[2], lines[2]);
  ASSERT_EQ(changes.added.size(), 1u);
  EXPECT_EQ(second.line_landmarks[1], changes.added[0]);
}

TEST_F(LineBuilderTest, TwoKeyframesTriangulateWhatNoneOfThemCouldAlone) {
  Keyframe first = See({}, false);
  // Points without landmarks give no line either.
  for (LandmarkId& id : first.landmarks) id = kNoLandmark;
  EXPECT_THAT(Add(first, LinesOf(first, false)).added, ::testing::IsEmpty());
  map_.map().keyframes.at(0).landmarks = points_;
  const Keyframe second = See({ExpSO3({0, 0.05, 0}), {0.4, 0.3, 0}}, false);
  const LineChanges changes = Add(second, LinesOf(second, false));
  ASSERT_EQ(changes.added.size(), kEdges.size());
  EXPECT_THAT(changes.observed, ::testing::ElementsAre(0));
  for (std::size_t i = 0; i < kEdges.size(); ++i) {
    const LineLandmark& line = map_.map().line_landmarks.at(map_.last().line_landmarks[i]);
    EXPECT_LT(ErrorOf(line, kEdges[i]), 0.002) << i;
    EXPECT_EQ(line.first_seen_by, 0);
    EXPECT_EQ(map_.map().keyframes.at(0).line_landmarks[i], line.id);
  }
}

}  // namespace
}  // namespace airslam
