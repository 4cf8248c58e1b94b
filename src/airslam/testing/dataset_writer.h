// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "airslam/testing/synthetic_sequence.h"

namespace airslam {

// Writes a sequence as an EuRoC ASL folder: `folder`/mav0 with cam0, cam1 (sensor.yaml, data.csv,
// data/<ns>.png), imu0 if the rig has one, and state_groundtruth_estimate0 at the IMU's times (at
// the frames' without an IMU). Existing files are replaced. Throws Error when a file can't be
// written, and when the rig's distortion has no EuRoC name.
void WriteEurocFolder(const SyntheticSequence& sequence, const std::filesystem::path& folder);

// Writes a sequence as a KITTI odometry folder: image_0, image_1 (six digits, .png), calib.txt,
// times.txt (from 0 on), poses.txt (left camera, relative to the first frame). Throws Error when a
// file can't be written, and when the rig is not rectified with the left camera as its body.
void WriteKittiFolder(const SyntheticSequence& sequence, const std::filesystem::path& folder);

}  // namespace airslam
