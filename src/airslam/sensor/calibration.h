// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "airslam/sensor/rig.h"

namespace airslam {

// All readers throw Error with one sentence that names the file and the field.

// Reads cam0/sensor.yaml, cam1/sensor.yaml and, where present, imu0/sensor.yaml below `mav0`
// (EuRoC ASL layout). T_BS is base_from_cam. With an IMU the body is the IMU (base_from_imu is the
// identity in EuRoC's own files); without one it is the base frame, and rig.imu stays empty.
StereoRig ReadEurocRig(const std::filesystem::path& mav0);

// Reads a Kalibr camchain file (cam0 and cam1) and, if `imu_yaml` is not empty, its IMU file. The
// body is the IMU where T_cam_imu (cam_from_imu) is present, else the left camera; the right camera
// stands by its own T_cam_imu, else by T_cn_cnm1 (cam1_from_cam0).
StereoRig ReadKalibrRig(const std::filesystem::path& camchain_yaml,
                        const std::filesystem::path& imu_yaml = {});

// Reads KITTI odometry's calib.txt: P0 and P1, both rectified; the body is the left camera. The
// size of the images is not in the file and must be given in pixels.
StereoRig ReadKittiRig(const std::filesystem::path& calib_txt, int width, int height);

// Reads one camera: an EuRoC sensor.yaml, or cam0 of a Kalibr camchain file. body_from_cam is T_BS,
// or the inverse of T_cam_imu; without either the camera is its own body.
RigCamera ReadCamera(const std::filesystem::path& yaml);

}  // namespace airslam
