// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/upright.h"

namespace airslam {

Eigen::Quaterniond UprightFromWorld(const Eigen::Vector3d& gravity_in_world) {
  return Eigen::Quaterniond::FromTwoVectors(gravity_in_world, -Eigen::Vector3d::UnitZ());
}

MapWriter::Update TurnComponent(const Eigen::Quaterniond& turned_from_world, int component,
                                Map& map, std::span<FrameRecord> records) {
  const Rigid3 turn(turned_from_world, Eigen::Vector3d::Zero());
  MapWriter::Update update;
  for (auto& [id, keyframe] : map.keyframes) {
    if (keyframe.component != component) continue;
    keyframe.world_from_cam = turn * keyframe.world_from_cam;
    update.world_from_cam.emplace_back(id, keyframe.world_from_cam);
    if (!keyframe.has_inertial_state) continue;
    keyframe.velocity_in_world = turn.rotation * keyframe.velocity_in_world;
    update.inertial_states.push_back(
        {id, keyframe.velocity_in_world, keyframe.gyroscope_bias, keyframe.accelerometer_bias});
  }
  for (auto& [id, landmark] : map.landmarks) {
    if (map.keyframes.at(landmark.first_seen_by).component != component) continue;
    landmark.point_in_world = turn * landmark.point_in_world;
    update.landmarks.push_back(landmark);
  }
  for (auto& [id, line] : map.line_landmarks) {
    if (map.keyframes.at(line.first_seen_by).component != component) continue;
    line.ends_in_world = {turn * line.ends_in_world.start, turn * line.ends_in_world.end};
    update.line_landmarks.push_back(line);
  }
  for (FrameRecord& record : records) {
    if (record.component != component) continue;
    record.online_world_from_cam = turn * record.online_world_from_cam;
  }
  return update;
}

}  // namespace airslam
