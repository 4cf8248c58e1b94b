// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "airslam/neural/detections.h"
#include "airslam/odometry/odometry.h"

namespace airslam::python {

// What Python is told of a frame when it has been tracked.
struct Frame {
  int index = 0;
  std::int64_t timestamp_ns = 0;
  std::string state;
  std::string problem;
  int component = -1;
  std::optional<Rigid3> world_from_body;
  bool is_keyframe = false;
  int tracked_points = 0;
  double milliseconds = 0;
  cv::Mat left;  // rectified, shared with the pipeline and not written to
  std::vector<Keypoint> keypoints;
  std::vector<TrackedPoint> points;
  std::shared_ptr<Keyframe> keyframe;  // null where it became none
  std::shared_ptr<Keyframe> lined;     // FrameObservation::lined
  std::optional<InertialEstimate> inertial;
  std::map<std::string, double> stage_ms;
};

// body_from_cam: of the rectified left camera.
Frame MakeFrame(const FrameObservation& seen, const Rigid3& body_from_cam);

}  // namespace airslam::python
