// SPDX-License-Identifier: BSD-3-Clause
//
// A small map whose geometry is consistent: three keyframes in a row see the same twelve points
// exactly.
#pragma once

#include <cmath>

#include "airslam/map/map.h"

namespace airslam {

inline Map TestScene() {
  Map map;
  map.model_pack = "pack";
  map.model_pack_sha256 = "abc123";
  map.calibration.stereo = {{400, 410, 320, 240, 640, 480}, 0.1};
  map.calibration.body_from_left =
      Rigid3(Eigen::Quaterniond(0.5, -0.5, 0.5, -0.5), {0.05, 0.02, 0.1});
  for (LandmarkId id = 0; id < 12; ++id) {
    const double column = static_cast<double>(id % 4), row = static_cast<double>(id / 4);
    map.landmarks[id] = {id, {column - 1.5, row - 1, 5 + 0.25 * column * row}, 0};
  }
  for (KeyframeId id = 0; id < 3; ++id) {
    Keyframe keyframe;
    keyframe.id = id;
    keyframe.timestamp_ns = 1'700'000'000'000'000'000 + 100'000'000LL * id;
    keyframe.world_from_cam =
        Rigid3(Eigen::Quaterniond(Eigen::AngleAxisd(0.02 * id, Eigen::Vector3d::UnitY())),
               {0.1 * id, 0, 0.05 * id});
    for (const auto& [landmark, point] : map.landmarks) {
      const Eigen::Vector3d p = keyframe.world_from_cam.Inverse() * point.point_in_world;
      const StereoCamera& stereo = map.calibration.stereo;
      const Eigen::Vector2d pixel = stereo.camera.Project(p);
      keyframe.keypoints.push_back(
          {static_cast<float>(pixel.x()), static_cast<float>(pixel.y()), 1});
      keyframe.right_x.push_back(
          static_cast<float>(pixel.x() - stereo.camera.fx * stereo.baseline / p.z()));
      keyframe.landmarks.push_back(landmark);
    }
    keyframe.descriptors = DescriptorMatrix::Identity(12, 16);
    map.keyframes[id] = std::move(keyframe);
  }
  return map;
}

}  // namespace airslam
