// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/keyframe_builder.h"

#include <set>

#include "airslam/odometry/motion_triangulation.h"

namespace airslam {

// A landmark found at a pixel of the new keyframe.
struct KeyframeBuilder::Claim {
  LandmarkId landmark;
  Eigen::Vector2d pixel;
  FeatureRef source;  // whose descriptor stands in where no keypoint was detected
  bool by_source;     // aligned to the patch that defines the landmark
};

std::vector<KeyframeBuilder::Claim> KeyframeBuilder::ClaimLandmarks(
    const FrameView& frame, const TrackedFrame& tracked) const {
  std::vector<Claim> claims;
  std::set<LandmarkId> taken;
  for (const TrackedPoint& point : tracked.points) {
    claims.push_back(
        {point.landmark, point.pixel, {tracked.keyframe, point.keyframe_index}, point.by_source});
    taken.insert(point.landmark);
  }
  // Landmarks of earlier keyframes that the last one did not hold may be in sight again.
  for (KeyframeId id : map_.window()) {
    for (LandmarkId landmark : map_.map().keyframes.at(id).landmarks) {
      if (landmark == kNoLandmark || !taken.insert(landmark).second) continue;
      const FeatureRef source = map_.Source(landmark);
      if (source.keyframe < 0) continue;
      if (const auto found =
              tracker_.Seek(frame.image, tracked.world_from_cam, landmark, source, 0, 0)) {
        claims.push_back({landmark, found->pixel, source, true});
      }
    }
  }
  return claims;
}

KeyframeDraft KeyframeBuilder::FromDetections(const FrameView& frame, std::int64_t timestamp_ns,
                                              int component, const Rigid3& world_from_cam) const {
  KeyframeDraft draft;
  Keyframe& keyframe = draft.keyframe;
  keyframe.id = map_.next_keyframe_id();
  keyframe.timestamp_ns = timestamp_ns;
  keyframe.component = component;
  keyframe.world_from_cam = world_from_cam;
  keyframe.keypoints = frame.features.detections().keypoints;
  keyframe.descriptors = frame.features.detections().descriptors;
  keyframe.landmarks.assign(keyframe.keypoints.size(), kNoLandmark);
  keyframe.right_x.assign(keyframe.keypoints.size(), -1.0f);
  return draft;
}

// The free keypoint nearest to `pixel`, or -1 when none lies close by.
int KeyframeBuilder::FreeKeypointAt(const FrameView& frame, const Keyframe& keyframe,
                                    const Eigen::Vector2d& pixel) {
  constexpr double kSamePlace = 2.5;  // pixels
  int nearest = -1;
  double nearest_distance = kSamePlace;
  frame.features.grid().VisitNear(pixel, kSamePlace, [&](int index) {
    const Keypoint& k = frame.features.detections().keypoints[index];
    const double distance = (Eigen::Vector2d(k.x, k.y) - pixel).norm();
    if (keyframe.landmarks[index] == kNoLandmark && distance < nearest_distance) {
      nearest = index;
      nearest_distance = distance;
    }
  });
  return nearest;
}

KeyframeDraft KeyframeBuilder::FromTracked(const FrameView& frame, std::int64_t timestamp_ns,
                                           const TrackedFrame& tracked) const {
  KeyframeDraft draft =
      FromDetections(frame, timestamp_ns, map_.last().component, tracked.world_from_cam);
  Keyframe& keyframe = draft.keyframe;
  const std::vector<Claim> claims = ClaimLandmarks(frame, tracked);
  const int detected = static_cast<int>(keyframe.keypoints.size());
  keyframe.descriptors.conservativeResize(detected + static_cast<int>(claims.size()),
                                          Eigen::NoChange);
  for (const Claim& claim : claims) {
    int index = FreeKeypointAt(frame, keyframe, claim.pixel);
    if (index < 0) {
      // Nothing was detected there: the keypoint and its descriptor come from another keyframe.
      const Keyframe& source = map_.map().keyframes.at(claim.source.keyframe);
      index = static_cast<int>(keyframe.keypoints.size());
      keyframe.descriptors.row(index) = source.descriptors.row(claim.source.index);
      keyframe.keypoints.push_back(source.keypoints[claim.source.index]);
      keyframe.landmarks.push_back(kNoLandmark);
    }
    keyframe.landmarks[index] = claim.landmark;
    keyframe.keypoints[index].x = static_cast<float>(claim.pixel.x());
    keyframe.keypoints[index].y = static_cast<float>(claim.pixel.y());
    if (!claim.by_source) draft.redefining.push_back(index);
  }
  keyframe.descriptors.conservativeResize(static_cast<int>(keyframe.keypoints.size()),
                                          Eigen::NoChange);
  keyframe.right_x.assign(keyframe.keypoints.size(), -1.0f);
  return draft;
}

void KeyframeBuilder::MatchRight(const FrameView& frame, ImagePyramid right_image,
                                 KeyframeDraft& draft) const {
  Keyframe& keyframe = draft.keyframe;
  draft.right_image = std::move(right_image);
  const Rigid3 cam_from_world = keyframe.world_from_cam.Inverse();
  std::vector<float> expected(keyframe.keypoints.size(), -1.0f);
  for (std::size_t i = 0; i < expected.size(); ++i) {
    if (keyframe.landmarks[i] == kNoLandmark) continue;
    const Eigen::Vector3d point =
        cam_from_world * map_.map().landmarks.at(keyframe.landmarks[i]).point_in_world;
    expected[i] = static_cast<float>(map_.stereo().Disparity(point.z()));
  }
  StereoMatchingOptions stereo;
  stereo.coarse_below = options_.tracking.coarse_below;
  const StereoView view{frame.image, draft.right_image, keyframe.keypoints};
  keyframe.right_x = MatchStereo(view, map_.stereo(), expected, stereo);
}

KeypointGrid KeyframeBuilder::OccupiedPlaces(const Keyframe& keyframe) const {
  std::vector<Keypoint> occupied;
  for (std::size_t i = 0; i < keyframe.keypoints.size(); ++i) {
    if (keyframe.landmarks[i] != kNoLandmark) occupied.push_back(keyframe.keypoints[i]);
  }
  return {occupied, map_.stereo().camera.width, map_.stereo().camera.height};
}

std::vector<LandmarkId> KeyframeBuilder::AddStereoLandmarks(Keyframe& keyframe) {
  const Pinhole& camera = map_.stereo().camera;
  const KeypointGrid occupied = OccupiedPlaces(keyframe);
  std::vector<LandmarkId> added;
  for (std::size_t i = 0; i < keyframe.keypoints.size(); ++i) {
    if (keyframe.landmarks[i] != kNoLandmark || keyframe.right_x[i] < 0) continue;
    const Eigen::Vector2d pixel(keyframe.keypoints[i].x, keyframe.keypoints[i].y);
    if (occupied.AnyNear(pixel, options_.keyframe.min_spacing)) continue;
    const double depth = map_.stereo().Depth(pixel.x() - keyframe.right_x[i]);
    const Eigen::Vector3d point_in_cam = depth * camera.Unproject(pixel);
    keyframe.landmarks[i] = map_.AddLandmark(keyframe.world_from_cam * point_in_cam);
    added.push_back(keyframe.landmarks[i]);
  }
  return added;
}

std::vector<LandmarkId> KeyframeBuilder::AddMotionLandmarks(const FrameView& frame,
                                                            Keyframe& keyframe) {
  std::vector<LandmarkId> added;
  if (map_.empty() || map_.last().component != keyframe.component) return added;
  const Keyframe& last = map_.last();
  const KeypointGrid occupied = OccupiedPlaces(keyframe);
  for (const MotionPoint& point :
       TriangulateFromMotion({last, map_.image(last.id).full()}, {keyframe, frame.image.full()},
                             map_.stereo().camera)) {
    if (occupied.AnyNear(point.later_pixel, options_.keyframe.min_spacing)) continue;
    const LandmarkId id = map_.AddLandmark(point.point_in_world);
    map_.AddObservation(id, {last.id, point.earlier_index});
    keyframe.landmarks[point.later_index] = id;
    keyframe.keypoints[point.later_index].x = static_cast<float>(point.later_pixel.x());
    keyframe.keypoints[point.later_index].y = static_cast<float>(point.later_pixel.y());
    added.push_back(id);
  }
  return added;
}

}  // namespace airslam
