// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/motion_triangulation.h"

#include <array>
#include <cmath>
#include <optional>

#include "airslam/feature/patch_alignment.h"
#include "airslam/geometry/triangulation.h"

namespace airslam {
namespace {

std::vector<int> WithoutDepth(const Keyframe& keyframe) {
  std::vector<int> indices;
  for (std::size_t i = 0; i < keyframe.keypoints.size(); ++i) {
    if (keyframe.landmarks[i] == kNoLandmark && keyframe.right_x[i] < 0) {
      indices.push_back(static_cast<int>(i));
    }
  }
  return indices;
}

Eigen::Vector2d Pixel(const Keyframe& keyframe, int index) {
  return {keyframe.keypoints[index].x, keyframe.keypoints[index].y};
}

// Mutually most similar keypoints near each other's epipolar line.
std::vector<Match> MatchEpipolar(const Keyframe& earlier, const Keyframe& later,
                                 const Pinhole& camera, const MotionTriangulationOptions& options) {
  const Rigid3 later_from_earlier = later.world_from_cam.Inverse() * earlier.world_from_cam;
  const std::vector<int> later_indices = WithoutDepth(later);
  std::vector<Match> best_earlier(later.keypoints.size());
  std::vector<Match> best_later;
  for (int i : WithoutDepth(earlier)) {
    // The plane through both camera centres and the ray, in the later camera.
    const Eigen::Vector3d normal = later_from_earlier.translation.cross(
        later_from_earlier.rotation * camera.Unproject(Pixel(earlier, i)));
    const double scale = normal.head<2>().norm() / camera.fx;
    Match best{i, -1, static_cast<float>(options.min_similarity)};
    for (int j : later_indices) {
      const double off_plane = std::abs(normal.dot(camera.Unproject(Pixel(later, j))));
      if (off_plane > options.max_epipolar_distance * scale) continue;
      const float similarity = earlier.descriptors.row(i).dot(later.descriptors.row(j));
      if (similarity > best.score) best = {i, j, similarity};
      if (best_earlier[j].index0 < 0 || similarity > best_earlier[j].score) {
        best_earlier[j] = {i, j, similarity};
      }
    }
    if (best.index1 >= 0) best_later.push_back(best);
  }
  std::erase_if(best_later,
                [&](const Match& m) { return best_earlier[m.index1].index0 != m.index0; });
  return best_later;
}

}  // namespace

std::vector<MotionPoint> TriangulateFromMotion(const KeyframeSight& earlier,
                                               const KeyframeSight& later, const Pinhole& camera,
                                               const MotionTriangulationOptions& options) {
  PatchAlignmentOptions alignment;
  alignment.min_correlation = options.min_correlation;
  TriangulationOptions triangulation;
  triangulation.min_parallax = options.min_parallax;
  triangulation.max_error = options.max_error / camera.fx;
  const Rigid3 earlier_from_world = earlier.keyframe.world_from_cam.Inverse();
  const Rigid3 later_from_world = later.keyframe.world_from_cam.Inverse();
  std::vector<MotionPoint> points;
  for (const Match& match : MatchEpipolar(earlier.keyframe, later.keyframe, camera, options)) {
    const Eigen::Vector2d pixel = Pixel(earlier.keyframe, match.index0);
    const PatchAlignment aligned =
        AlignPatch(earlier.image, pixel, Eigen::Matrix2d::Identity(), later.image,
                   Pixel(later.keyframe, match.index1), alignment);
    if (!aligned.converged) continue;
    const std::array<RayObservation, 2> rays = {
        RayObservation{earlier_from_world, camera.Unproject(pixel)},
        RayObservation{later_from_world, camera.Unproject(aligned.pixel)}};
    if (const auto point = TriangulatePoint(rays, triangulation)) {
      points.push_back({match.index0, match.index1, aligned.pixel, *point});
    }
  }
  return points;
}

}  // namespace airslam
