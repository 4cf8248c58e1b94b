// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/place/match_verification.h"

#include <Eigen/Cholesky>
#include <algorithm>

#include "airslam/common/options.h"

namespace airslam {
namespace {

// Matches whose keypoint in the keyframe sees a landmark.
std::vector<PlaceInlier> MatchLandmarks(const PlaceView& view, const Map& map,
                                        const Keyframe& keyframe, FeatureMatcher& matcher) {
  const Pinhole& camera = map.calibration.stereo.camera;
  const std::vector<Match> matches = matcher.Match(
      {view.keypoints, view.descriptors, cv::Size(view.camera.width, view.camera.height)},
      {keyframe.keypoints, keyframe.descriptors, cv::Size(camera.width, camera.height)});
  std::vector<PlaceInlier> found;
  for (const Match& match : matches) {
    const LandmarkId landmark = keyframe.landmarks[static_cast<std::size_t>(match.index1)];
    if (landmark != kNoLandmark) found.push_back({match.index0, match.index1, landmark});
  }
  return found;
}

Eigen::Vector2d Pixel(const PlaceView& view, const PlaceInlier& match) {
  const Keypoint& k = view.keypoints[static_cast<std::size_t>(match.keypoint)];
  return {k.x, k.y};
}

// The sightings whose pixel lies where the pose expects the point.
std::vector<int> Agreeing(const Pinhole& camera, const std::vector<PointSighting>& sightings,
                          const Rigid3& world_from_cam, const VerificationOptions& options) {
  const Rigid3 cam_from_world = world_from_cam.Inverse();
  std::vector<int> agreeing;
  for (std::size_t i = 0; i < sightings.size(); ++i) {
    const Eigen::Vector3d point = cam_from_world * sightings[i].point_in_world;
    if (point.z() <= 0) continue;
    const double error = (camera.Project(point) - sightings[i].pixel).norm();
    if (error <= options.pose.max_error * options.pixel_sigma) {
      agreeing.push_back(static_cast<int>(i));
    }
  }
  return agreeing;
}

// The inverse information, scaled by what the residuals show.
Matrix6d Covariance(const StereoCamera& mono, const std::vector<PointConstraint>& inliers,
                    const Rigid3& world_from_cam, double rms) {
  const Matrix6d information = PoseInformation(mono, inliers, world_from_cam);
  const auto n = static_cast<double>(inliers.size());
  // Degrees of freedom: two a point less six of the pose.
  const double variance = n > 3 ? n * rms * rms / (2 * n - 6) : 1;
  return std::max(variance, 1.0) * information.ldlt().solve(Matrix6d::Identity());
}

}  // namespace

void VerificationOptions::Validate() const {
  ransac.Validate();
  RequireOption(pixel_sigma > 0, "pixel_sigma", pixel_sigma, "must be positive");
}

PlaceMatch VerifyPlace(const PlaceView& view, const Map& map, const Keyframe& keyframe,
                       FeatureMatcher& matcher, const VerificationOptions& options) {
  PlaceMatch result;
  result.keyframe = keyframe.id;
  const std::vector<PlaceInlier> matches = MatchLandmarks(view, map, keyframe, matcher);
  result.matches = static_cast<int>(matches.size());
  std::vector<PointSighting> sightings;
  for (const PlaceInlier& m : matches) {
    sightings.push_back({map.landmarks.at(m.landmark).point_in_world, Pixel(view, m)});
  }
  const PnpRansacResult ransac = EstimatePnpRansac(view.camera, sightings, options.ransac);
  if (ransac.inliers.empty()) return result;

  // The sightings that agree with a pose of four noisy ones are a choice in its favour: all that
  // agree with the refined pose are taken instead, and the pose refined on them, twice.
  constexpr int kRefinements = 3;
  const StereoCamera mono{view.camera, 0};
  std::vector<int> chosen = ransac.inliers;
  PoseOptimizationResult pose;
  pose.world_from_cam = ransac.cam_from_world.Inverse();
  std::vector<PointConstraint> constraints;
  for (int i = 0; i < kRefinements; ++i) {
    if (i > 0) chosen = Agreeing(view.camera, sightings, pose.world_from_cam, options);
    constraints.clear();
    for (const int index : chosen) {
      const PointSighting& s = sightings[static_cast<std::size_t>(index)];
      constraints.push_back({s.point_in_world, PointObservation{s.pixel, -1, options.pixel_sigma}});
    }
    pose = OptimizePose(mono, constraints, pose.world_from_cam, {}, options.pose);
    if (pose.inliers == 0) return result;
  }

  std::vector<PointConstraint> kept;
  for (std::size_t i = 0; i < chosen.size(); ++i) {
    if (!pose.inlier[i]) continue;
    kept.push_back(constraints[i]);
    result.inliers.push_back(matches[static_cast<std::size_t>(chosen[i])]);
  }
  result.world_from_cam = pose.world_from_cam;
  result.rms = pose.rms;
  result.covariance = Covariance(mono, kept, pose.world_from_cam, pose.rms);
  return result;
}

}  // namespace airslam
