// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "airslam/geometry/rigid3.h"

namespace airslam {

// A pose of the body at one time.
struct StampedPose {
  std::int64_t timestamp_ns = 0;
  Rigid3 world_from_body;
};
using Trajectory = std::vector<StampedPose>;

// TUM format: `seconds tx ty tz qx qy qz qw` a line, world_from_body, seconds with nine decimals
// written exactly from the integer nanoseconds. Replaces the file atomically.
void WriteTum(const std::filesystem::path& file, const Trajectory& trajectory);

// Reads a trajectory of the format its content shows: TUM, EuRoC ground truth csv (timestamp [ns],
// p, q_wxyz, ...), or KITTI poses (12 numbers a line; times come from `times.txt` beside the file,
// else the running number in seconds; the body is the left camera). Sorted by time. Errors name
// file and line; a time that occurs twice is one. A TUM file whose times are nanoseconds (as
// ORB-SLAM3 writes it) is understood: seconds have at most ten digits before the point.
Trajectory ReadTrajectory(const std::filesystem::path& file);

}  // namespace airslam
