// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/refine/loop_verification.h"

#include <algorithm>
#include <cmath>

#include "airslam/place/match_verification.h"

namespace airslam {
namespace {

// What the covariance of a pose from points does not hold: errors that the landmarks of a keyframe
// share.
constexpr double kLeastAngleSigma = 1e-3;     // rad
constexpr double kLeastDistanceSigma = 3e-3;  // metres

PlaceMatch Locate(const Map& map, const Keyframe& seen, const Keyframe& in, FeatureMatcher& matcher,
                  const LoopClosureOptions& options) {
  VerificationOptions verification;
  verification.pixel_sigma = options.pixel_sigma;
  verification.ransac.max_error = options.ransac_error;
  return VerifyPlace({seen.keypoints, seen.descriptors, map.calibration.stereo.camera}, map, in,
                     matcher, verification);
}

// Of the inliers' points from the located camera, metres.
double MedianDepth(const Map& map, const PlaceMatch& match) {
  std::vector<double> depths;
  const Rigid3 cam_from_world = match.world_from_cam.Inverse();
  for (const PlaceInlier& inlier : match.inliers) {
    depths.push_back((cam_from_world * map.landmarks.at(inlier.landmark).point_in_world).z());
  }
  std::nth_element(depths.begin(), depths.begin() + depths.size() / 2, depths.end());
  return depths[depths.size() / 2];
}

// Of the residual of a RelativePose, which is an error in the later camera.
Matrix6d LoopCovariance(const PlaceMatch& match) {
  Matrix6d camera_from_world = Matrix6d::Identity();
  camera_from_world.bottomRightCorner<3, 3>() =
      match.world_from_cam.rotation.conjugate().toRotationMatrix();
  Matrix6d covariance = camera_from_world * match.covariance * camera_from_world.transpose();
  covariance.diagonal().head<3>().array() += kLeastAngleSigma * kLeastAngleSigma;
  covariance.diagonal().tail<3>().array() += kLeastDistanceSigma * kLeastDistanceSigma;
  return covariance;
}

std::optional<Loop> Refuse(std::string* refusal, const char* why) {
  if (refusal != nullptr) *refusal = why;
  return std::nullopt;
}

}  // namespace

std::optional<Loop> VerifyLoop(const Map& map, KeyframeId earlier_id, KeyframeId later_id,
                               FeatureMatcher& matcher, const LoopClosureOptions& options,
                               std::string* refusal) {
  const Keyframe& earlier = map.keyframes.at(earlier_id);
  const Keyframe& later = map.keyframes.at(later_id);
  const PlaceMatch forth = Locate(map, later, earlier, matcher, options);
  if (static_cast<int>(forth.inliers.size()) <= options.min_inliers) {
    return Refuse(refusal, "too few inliers");
  }
  const PlaceMatch back = Locate(map, earlier, later, matcher, options);
  if (2 * static_cast<int>(back.inliers.size()) <= options.min_inliers) {
    return Refuse(refusal, "too few inliers the other way round");
  }
  Loop loop;
  loop.earlier = earlier_id;
  loop.later = later_id;
  loop.matches = forth.matches;
  loop.inliers = static_cast<int>(forth.inliers.size());
  loop.earlier_from_later = earlier.world_from_cam.Inverse() * forth.world_from_cam;
  const Rigid3 later_from_earlier = later.world_from_cam.Inverse() * back.world_from_cam;
  const Rigid3 difference = loop.earlier_from_later * later_from_earlier;
  if (difference.translation.norm() > options.max_disagreement * MedianDepth(map, forth) ||
      difference.Angle() > options.max_disagreement_angle) {
    return Refuse(refusal, "both ways disagree");
  }
  loop.covariance = LoopCovariance(forth);
  for (const PlaceInlier& inlier : forth.inliers) {
    loop.keypoints.emplace_back(inlier.keyframe_keypoint, inlier.keypoint);
  }
  return loop;
}

}  // namespace airslam
