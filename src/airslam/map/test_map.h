// SPDX-License-Identifier: BSD-3-Clause
//
// Small maps for tests, random but the same on every run.
#pragma once

#include <random>
#include <span>
#include <vector>

#include "airslam/map/map_file.h"

namespace airslam {

inline MapCalibration TestCalibration() {
  MapCalibration calibration;
  calibration.stereo = {{458.654, 457.296, 367.215, 248.375, 752, 480}, 0.110073808};
  calibration.body_from_left =
      Rigid3(Eigen::Quaterniond(0.7, -0.1, 0.2, 0.68), {-0.02, 0.06, 0.01});
  calibration.has_imu = true;
  return calibration;
}

// A keyframe of `n` keypoints with descriptors of length 64. Keypoint i sees landmark
// first_landmark + i, every fifth none.
inline Keyframe TestKeyframe(KeyframeId id, int n, LandmarkId first_landmark) {
  std::mt19937 random(static_cast<unsigned>(id));
  std::normal_distribution<double> normal;
  Keyframe keyframe;
  keyframe.id = id;
  keyframe.timestamp_ns = 1'403'636'579'763'555'584 + 50'000'000LL * id;
  keyframe.world_from_cam =
      Rigid3(Eigen::Quaterniond(normal(random), normal(random), normal(random), normal(random)),
             {normal(random), normal(random), normal(random)});
  keyframe.descriptors.resize(n, 64);
  for (int i = 0; i < n; ++i) {
    keyframe.keypoints.push_back({static_cast<float>(376 + 100 * normal(random)),
                                  static_cast<float>(240 + 60 * normal(random)),
                                  static_cast<float>(normal(random))});
    keyframe.right_x.push_back(i % 3 == 0 ? -1.0f : keyframe.keypoints.back().x - 10.5f);
    keyframe.landmarks.push_back(i % 5 == 4 ? kNoLandmark : first_landmark + i);
    for (int d = 0; d < 64; ++d) keyframe.descriptors(i, d) = static_cast<float>(normal(random));
  }
  keyframe.descriptors.rowwise().normalize();
  return keyframe;
}

// The landmarks that the keyframe sees, first seen by it.
inline std::vector<Landmark> TestLandmarks(const Keyframe& keyframe) {
  std::vector<Landmark> landmarks;
  for (const LandmarkId id : keyframe.landmarks) {
    if (id == kNoLandmark) continue;
    const double x = static_cast<double>(id);
    landmarks.push_back({id, {x / 3, -x / 7, x / 11}, keyframe.id});
  }
  return landmarks;
}

// Writes keyframes 0 .. count - 1 of `n` keypoints each, none of whose landmarks are shared.
inline void WriteTestMap(const std::filesystem::path& file, int count, int n) {
  MapWriter writer(file, TestCalibration(), "pack", "abc123");
  for (KeyframeId id = 0; id < count; ++id) {
    const Keyframe keyframe = TestKeyframe(id, n, 1000 * id);
    writer.AddKeyframe(keyframe, TestLandmarks(keyframe));
  }
  writer.Close();
}

}  // namespace airslam
