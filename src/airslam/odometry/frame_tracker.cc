// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/frame_tracker.h"

#include <set>
#include <utility>

#include "airslam/optimize/pnp_ransac.h"

namespace airslam {
namespace {

constexpr double kMinDepth = 0.05;  // metres

// How a small patch around `pixel` of the reference camera changes its shape in the current one,
// taking the surface there to be parallel to the reference image at `depth`.
Eigen::Matrix2d LocalWarp(const Pinhole& camera, const Eigen::Vector2d& pixel, double depth,
                          const Rigid3& current_from_reference) {
  constexpr double kStep = 4.0;  // pixels
  const auto transfer = [&](const Eigen::Vector2d& p) {
    return camera.Project(current_from_reference * Eigen::Vector3d(depth * camera.Unproject(p)));
  };
  const Eigen::Vector2d center = transfer(pixel);
  Eigen::Matrix2d warp;
  warp.col(0) = (transfer(pixel + Eigen::Vector2d(kStep, 0)) - center) / kStep;
  warp.col(1) = (transfer(pixel + Eigen::Vector2d(0, kStep)) - center) / kStep;
  return warp;
}

// In how many square cells of the image the pixels lie.
int CountCells(const std::vector<Eigen::Vector2d>& pixels) {
  constexpr double kCell = 64;  // pixels
  std::set<std::pair<int, int>> cells;
  for (const Eigen::Vector2d& p : pixels) {
    cells.emplace(static_cast<int>(p.x() / kCell), static_cast<int>(p.y() / kCell));
  }
  return static_cast<int>(cells.size());
}

}  // namespace

std::vector<Match> FrameTracker::MatchNearPrediction(const FrameView& frame,
                                                     const Keyframe& keyframe,
                                                     const Rigid3& world_from_cam) const {
  const Pinhole& camera = map_.stereo().camera;
  const double radius = options_.search_radius * camera.width;
  const Rigid3 cam_from_world = world_from_cam.Inverse();
  std::vector<Expectation> expectations;
  for (std::size_t i = 0; i < keyframe.landmarks.size(); ++i) {
    if (keyframe.landmarks[i] == kNoLandmark) continue;
    const Eigen::Vector3d point =
        cam_from_world * map_.map().landmarks.at(keyframe.landmarks[i]).point_in_world;
    if (point.z() < kMinDepth) continue;
    const Eigen::Vector2d pixel = camera.Project(point);
    if (camera.Contains(pixel, -radius)) expectations.push_back({static_cast<int>(i), pixel});
  }
  return MatchExpectations(expectations, keyframe.descriptors, frame.features.grid(),
                           frame.features.detections().descriptors,
                           {radius, options_.min_similarity});
}

std::vector<Match> FrameTracker::MatchLearned(const FrameView& frame,
                                              const Keyframe& keyframe) const {
  const Pinhole& camera = map_.stereo().camera;
  const cv::Size size(camera.width, camera.height);
  const Detections& seen = frame.features.detections();
  std::vector<Match> matches = matcher_.Match({keyframe.keypoints, keyframe.descriptors, size},
                                              {seen.keypoints, seen.descriptors, size});
  std::erase_if(matches,
                [&](const Match& m) { return keyframe.landmarks[m.index0] == kNoLandmark; });
  return matches;
}

PoseOptimizationResult FrameTracker::PoseFromMatches(const FrameView& frame,
                                                     const Keyframe& keyframe,
                                                     const std::vector<Match>& matches) const {
  std::vector<PointSighting> sightings;
  for (const Match& match : matches) {
    const Keypoint& k = frame.features.detections().keypoints[match.index1];
    sightings.push_back(
        {map_.map().landmarks.at(keyframe.landmarks[match.index0]).point_in_world, {k.x, k.y}});
  }
  const PnpRansacResult ransac =
      EstimatePnpRansac(map_.stereo().camera, sightings,
                        {.max_error = options_.ransac_error, .iterations = 200, .minimal = false});
  std::vector<PointConstraint> constraints;
  for (const int i : ransac.inliers) {
    constraints.push_back(
        {sightings[i].point_in_world, PointObservation{sightings[i].pixel, -1, 1.0}});
  }
  return OptimizePose(map_.stereo(), constraints, ransac.cam_from_world.Inverse(), {}, {});
}

std::optional<FrameTracker::Found> FrameTracker::Seek(const ImagePyramid& image,
                                                      const Rigid3& world_from_cam,
                                                      LandmarkId landmark, const FeatureRef& source,
                                                      int first, int last) const {
  const Pinhole& camera = map_.stereo().camera;
  const Eigen::Vector3d& point_in_world = map_.map().landmarks.at(landmark).point_in_world;
  const Rigid3 cam_from_world = world_from_cam.Inverse();
  const Eigen::Vector3d point_in_cam = cam_from_world * point_in_world;
  if (point_in_cam.z() < kMinDepth) return std::nullopt;
  const Eigen::Vector2d expected = camera.Project(point_in_cam);
  if (!camera.Contains(expected)) return std::nullopt;

  const Keyframe& keyframe = map_.map().keyframes.at(source.keyframe);
  const Keypoint& keypoint = keyframe.keypoints[source.index];
  const Eigen::Vector2d pixel(keypoint.x, keypoint.y);
  const double depth = (keyframe.world_from_cam.Inverse() * point_in_world).z();
  if (depth < kMinDepth) return std::nullopt;
  const Eigen::Matrix2d warp =
      LocalWarp(camera, pixel, depth, cam_from_world * keyframe.world_from_cam);
  PatchAlignmentOptions alignment;
  alignment.min_correlation = options_.min_correlation;
  const ImagePyramid& source_image = map_.image(source.keyframe);
  for (int level = first; level <= last; ++level) {
    const double scale = 1 << level;
    const PatchAlignment aligned = AlignPatch(source_image.levels[level], pixel / scale, warp,
                                              image.levels[level], expected / scale, alignment);
    if (aligned.converged) return Found{aligned.pixel * scale, options_.pixel_sigma * scale};
  }
  return std::nullopt;
}

PoseOptimizationResult FrameTracker::PoseFromCoarsePatches(const FrameView& frame,
                                                           const Keyframe& keyframe,
                                                           const PosePrior& prediction) const {
  std::vector<PointConstraint> constraints;
  for (LandmarkId landmark : keyframe.landmarks) {
    if (landmark == kNoLandmark) continue;
    const FeatureRef source = map_.Source(landmark);
    if (source.keyframe < 0) continue;
    constexpr int kCoarsest = ImagePyramid::kLevels - 1;
    if (const auto found =
            Seek(frame.image, prediction.world_from_cam, landmark, source, kCoarsest, kCoarsest)) {
      constraints.push_back({map_.map().landmarks.at(landmark).point_in_world,
                             PointObservation{found->pixel, -1, found->sigma}});
    }
  }
  return OptimizePose(map_.stereo(), constraints, prediction.world_from_cam, prediction, {});
}

std::optional<TrackedFrame> FrameTracker::AlignAndOptimize(
    const FrameView& frame, const Keyframe& keyframe, const Rigid3& world_from_cam,
    const std::optional<PosePrior>& prior) const {
  auto fine = AlignAtLevels(frame, keyframe, world_from_cam, prior, 0);
  if (fine && static_cast<int>(fine->points.size()) >= options_.coarse_below) return fine;
  const Rigid3& start = fine ? fine->world_from_cam : world_from_cam;
  auto coarse = AlignAtLevels(frame, keyframe, start, prior, 1);
  return coarse ? coarse : fine;
}

std::optional<TrackedFrame> FrameTracker::AlignAtLevels(const FrameView& frame,
                                                        const Keyframe& keyframe,
                                                        const Rigid3& world_from_cam,
                                                        const std::optional<PosePrior>& prior,
                                                        int last_level) const {
  std::vector<TrackedPoint> candidates;
  std::vector<PointConstraint> constraints;
  for (std::size_t i = 0; i < keyframe.landmarks.size(); ++i) {
    const LandmarkId landmark = keyframe.landmarks[i];
    if (landmark == kNoLandmark) continue;
    const FeatureRef own{keyframe.id, static_cast<int>(i)};
    const FeatureRef source = map_.Source(landmark);
    std::optional<Found> found;
    bool by_source = false;
    if (source.keyframe >= 0) {
      found = Seek(frame.image, world_from_cam, landmark, source, 0, last_level);
      by_source = found.has_value();
    }
    if (!found && source.keyframe != own.keyframe) {
      found = Seek(frame.image, world_from_cam, landmark, own, 0, last_level);
    }
    if (!found) continue;
    candidates.push_back({own.index, landmark, found->pixel, by_source});
    constraints.push_back({map_.map().landmarks.at(landmark).point_in_world,
                           PointObservation{found->pixel, -1, found->sigma}});
  }
  const PoseOptimizationResult pose =
      OptimizePose(map_.stereo(), constraints, world_from_cam, prior, {});
  if (pose.inliers < options_.min_tracked) return std::nullopt;

  TrackedFrame result;
  result.keyframe = keyframe.id;
  result.world_from_cam = pose.world_from_cam;
  result.rms = pose.rms;
  result.in_sight = static_cast<int>(InSight(keyframe, pose.world_from_cam).size());
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    if (!pose.inlier[i]) continue;
    const Keypoint& k = keyframe.keypoints[candidates[i].keyframe_index];
    result.mean_parallax += (candidates[i].pixel - Eigen::Vector2d(k.x, k.y)).norm();
    result.points.push_back(candidates[i]);
  }
  result.mean_parallax /= static_cast<double>(result.points.size());
  return result;
}

bool FrameTracker::IsConvincing(const TrackedFrame& tracked) const {
  const int found = static_cast<int>(tracked.points.size());
  return found >= options_.min_convincing && found >= options_.min_found_share * tracked.in_sight;
}

std::optional<TrackedFrame> FrameTracker::Track(const FrameView& frame, const Keyframe& keyframe,
                                                const PosePrior& prediction) const {
  std::optional<TrackedFrame> best;
  const auto consider = [&](const PoseOptimizationResult& start) {
    if (start.inliers < options_.min_tracked) return;
    auto tracked = AlignAndOptimize(frame, keyframe, start.world_from_cam, prediction);
    if (tracked && (!best || tracked->points.size() > best->points.size())) best = tracked;
  };
  consider(PoseFromCoarsePatches(frame, keyframe, prediction));
  if (best && IsConvincing(*best)) return best;
  const PoseOptimizationResult guided = PoseFromMatches(
      frame, keyframe, MatchNearPrediction(frame, keyframe, prediction.world_from_cam));
  consider(guided);
  if (guided.inliers >= options_.min_convincing && best && IsConvincing(*best)) return best;
  // A few features may agree on a wrong pose, shelves that repeat for one: of several poses the one
  // around which more of the image fits is kept.
  consider(PoseFromMatches(frame, keyframe, MatchLearned(frame, keyframe)));
  if (best) best->used_matcher = true;
  return best;
}

std::optional<TrackedFrame> FrameTracker::Relocate(const FrameView& frame, const Keyframe& keyframe,
                                                   const RecoveryOptions& recovery) const {
  const PoseOptimizationResult pose =
      PoseFromMatches(frame, keyframe, MatchLearned(frame, keyframe));
  if (pose.inliers < recovery.min_inliers) return std::nullopt;
  auto tracked = AlignAndOptimize(frame, keyframe, pose.world_from_cam, {});
  if (!tracked) return std::nullopt;
  if (static_cast<int>(tracked->points.size()) < recovery.min_inliers) return std::nullopt;
  std::vector<Eigen::Vector2d> found;
  for (const TrackedPoint& point : tracked->points) found.push_back(point.pixel);
  const int cells_in_sight = CountCells(InSight(keyframe, tracked->world_from_cam));
  if (CountCells(found) < recovery.min_found_share * cells_in_sight) return std::nullopt;
  tracked->used_matcher = true;
  return tracked;
}

std::vector<Eigen::Vector2d> FrameTracker::InSight(const Keyframe& keyframe,
                                                   const Rigid3& world_from_cam) const {
  const Pinhole& camera = map_.stereo().camera;
  const Rigid3 cam_from_world = world_from_cam.Inverse();
  std::vector<Eigen::Vector2d> pixels;
  for (LandmarkId landmark : keyframe.landmarks) {
    if (landmark == kNoLandmark) continue;
    const Eigen::Vector3d point = cam_from_world * map_.map().landmarks.at(landmark).point_in_world;
    if (point.z() < kMinDepth) continue;
    const Eigen::Vector2d pixel = camera.Project(point);
    if (camera.Contains(pixel)) pixels.push_back(pixel);
  }
  return pixels;
}

}  // namespace airslam
