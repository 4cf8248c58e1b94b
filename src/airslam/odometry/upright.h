// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>

#include <span>

#include "airslam/map/map.h"
#include "airslam/map/map_file.h"
#include "airslam/odometry/frame_record.h"

namespace airslam {

// The smallest rotation after which gravity points along -z.
Eigen::Quaterniond UprightFromWorld(const Eigen::Vector3d& gravity_in_world);

// Turns the world of a component about its origin: keyframes with their velocities, points, lines,
// and the frames as first estimated. Returns what changed in the map.
MapWriter::Update TurnComponent(const Eigen::Quaterniond& turned_from_world, int component,
                                Map& map, std::span<FrameRecord> records);

}  // namespace airslam
