// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/map/keyframe_trajectory.h"

#include <algorithm>

namespace airslam {

int LargestMapComponent(const Map& map) {
  std::map<int, int> sizes;
  for (const auto& [id, keyframe] : map.keyframes) ++sizes[keyframe.component];
  int largest = -1;
  for (const auto& [component, size] : sizes) {
    if (largest < 0 || size > sizes[largest]) largest = component;
  }
  return largest;
}

Trajectory MapTrajectory(const Map& map, int component) {
  const Rigid3 left_from_body = map.calibration.body_from_left.Inverse();
  Trajectory trajectory;
  for (const auto& [id, keyframe] : map.keyframes) {
    if (keyframe.component != component) continue;
    trajectory.push_back({keyframe.timestamp_ns, keyframe.world_from_cam * left_from_body});
  }
  // A map that was joined from two sessions need not hold them in order of time.
  std::stable_sort(
      trajectory.begin(), trajectory.end(),
      [](const StampedPose& a, const StampedPose& b) { return a.timestamp_ns < b.timestamp_ns; });
  return trajectory;
}

}  // namespace airslam
