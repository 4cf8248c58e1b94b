// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <vector>

#include "airslam/map/map.h"

namespace airslam {

// Who sees each point landmark, and with which keypoint, by ascending keyframe. A keyframe that
// names one twice counts once, with the first of its keypoints.
std::map<LandmarkId, std::vector<FeatureRef>> CollectObservations(const Map& map);

// Moves keyframes (with their velocities) to new poses, and each landmark along with the keyframe
// that first saw it. Keyframes that `world_from_cam` does not name stay.
void MoveKeyframes(const std::map<KeyframeId, Rigid3>& world_from_cam, Map& map);

// Forgets points and lines that no keyframe sees any more. Returns how many points.
int RemoveUnseenLandmarks(Map& map);

// What a map looks like from outside.
struct MapErrors {
  int keyframes = 0, components = 0;
  std::int64_t landmarks = 0, observations = 0;
  // Pixels between observations in the left image and their projected landmarks.
  double median_error = 0, rms_error = 0;
};
MapErrors MeasureErrors(const Map& map);

}  // namespace airslam
