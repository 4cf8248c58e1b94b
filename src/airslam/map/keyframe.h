// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include <cstdint>
#include <vector>

#include "airslam/geometry/plucker_line.h"
#include "airslam/geometry/rigid3.h"
#include "airslam/neural/detections.h"
#include "airslam/sensor/imu.h"

namespace airslam {

using KeyframeId = std::int32_t;  // running number in order of creation, unique in a map
// Running number in order of creation, unique in a map; points and lines are numbered apart.
using LandmarkId = std::int64_t;
inline constexpr LandmarkId kNoLandmark = -1;

// Where a keyframe sees something: keypoint or line `index` of keyframe `keyframe`.
struct FeatureRef {
  KeyframeId keyframe = -1;
  int index = -1;
};

// A frame that is part of the map. Pixels are those of the rectified left image.
struct Keyframe {
  KeyframeId id = -1;
  std::int64_t timestamp_ns = 0;
  int component = 0;      // keyframes of different components share no world frame
  Rigid3 world_from_cam;  // rectified left camera

  // Detected keypoints with their descriptors, followed by none other: row i of `descriptors`,
  // `right_x[i]` and `landmarks[i]` belong to keypoints[i].
  std::vector<Keypoint> keypoints;
  DescriptorMatrix descriptors;
  std::vector<float> right_x;         // column of the match in the right image; < 0: none
  std::vector<LandmarkId> landmarks;  // kNoLandmark: none

  // Detected lines: row i of `right_lines` and `line_landmarks` belongs to lines[i]. A line's ends
  // are junctions, from which they have moved onto the line's edge (RefineLine).
  std::vector<LineSegment> lines;
  std::vector<LineSegment> right_lines;    // the match in the right image; score < 0: none
  std::vector<LandmarkId> line_landmarks;  // of Map::line_landmarks; kNoLandmark: none
  std::vector<Keypoint> junctions;
  DescriptorMatrix junction_descriptors;

  // Inertial state: velocity of the body in world (m/s), biases (rad/s, m/s^2).
  bool has_inertial_state = false;
  Eigen::Vector3d velocity_in_world = Eigen::Vector3d::Zero();
  Eigen::Vector3d gyroscope_bias = Eigen::Vector3d::Zero();
  Eigen::Vector3d accelerometer_bias = Eigen::Vector3d::Zero();
  // What the IMU read since the component's previous keyframe, in image time: the first sample at
  // that keyframe's time, the last at this one's. Empty: no IMU, or readings are missing.
  std::vector<ImuSample> imu_samples;
  ImuNoise imu_noise;  // of these samples
};

// A 3D point seen by keyframes.
struct Landmark {
  LandmarkId id = kNoLandmark;
  Eigen::Vector3d point_in_world = Eigen::Vector3d::Zero();
  KeyframeId first_seen_by = -1;  // the point moves with this keyframe in pose graphs
};

// A 3D line seen by keyframes: endless for observations, from end to end for people.
struct LineLandmark {
  LandmarkId id = kNoLandmark;
  // The stretch that keyframes have seen, metres in world; its ends differ, and the line goes
  // through them.
  SpaceSegment ends_in_world;
  KeyframeId first_seen_by = -1;  // the line moves with this keyframe in pose graphs

  PluckerLine line_in_world() const {
    return PluckerLine::FromPoints(ends_in_world.start, ends_in_world.end, 0)
        .value_or(PluckerLine{});
  }
};

}  // namespace airslam
