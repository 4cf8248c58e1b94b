// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "airslam/dataset/trajectory.h"
#include "airslam/map/map.h"

namespace airslam {

// The component with the most keyframes (the smaller number of equals); -1 for an empty map.
int LargestMapComponent(const Map& map);

// world_from_body of the component's keyframes, in order of time.
Trajectory MapTrajectory(const Map& map, int component);

}  // namespace airslam
