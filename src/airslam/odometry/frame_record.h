// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include "airslam/geometry/rigid3.h"
#include "airslam/map/keyframe.h"

namespace airslam {

enum class FrameState {
  kInitialized,  // first keyframe of a component
  kTracked,
  kInertial,  // vision found nothing: its pose is integrated from the IMU
  kLost,      // no pose
  kSkipped,   // its images could not be used
};

// What is known of one frame. Its pose hangs on a keyframe and moves with it.
struct FrameRecord {
  std::int64_t timestamp_ns = 0;
  FrameState state = FrameState::kLost;
  int component = -1;  // -1 without a pose
  KeyframeId reference = -1;
  Rigid3 reference_from_cam;     // rectified left cameras
  Rigid3 online_world_from_cam;  // as first estimated
  int tracked_points = 0;
  bool is_keyframe = false;
  bool used_matcher = false;
  double milliseconds = 0;  // of tracking this frame

  bool has_pose() const { return component >= 0; }
};

}  // namespace airslam
