// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "airslam/map/map.h"
#include "airslam/testing/synthetic_motion.h"
#include "airslam/testing/synthetic_world.h"

namespace airslam {

struct SyntheticMapOptions {
  SyntheticWorldOptions world;
  SyntheticTrajectory trajectory = SyntheticTrajectory::Loop();  // mounted by the map
  int keyframes = 24;
  double interval = 1;  // seconds between keyframes
  int copies = 1;       // buildings, one beside the other, visited one after the other
  std::uint32_t seed = 1;
  int max_keypoints = 350;        // of a keyframe
  double pixel_noise = 0.3;       // standard deviation
  double descriptor_noise = 0.3;  // length of the noise on a unit-length descriptor
  // What odometry gets wrong at every keyframe, standard deviations in metres and rad, about a
  // constant part of the same size: drift.
  double drift = 0;
  double drift_angle = 0;
};

// A map as odometry leaves it, without images: keyframes that saw points of the synthetic world,
// each point with a descriptor of its own. A point that the previous keyframe did not see gets a
// new landmark, so that a place that is seen again is not recognised. All estimates (poses,
// landmarks) drift away from the truth as odometry does; the first keyframe is exact.
struct SyntheticMap {
  Map map;
  std::map<KeyframeId, Rigid3> true_world_from_cam;
  // The world's point that each landmark is.
  std::map<LandmarkId, int> point_of_landmark;
};

SyntheticMap MakeSyntheticMap(const SyntheticMapOptions& options);

// Root mean square distance of keyframes from the truth, metres, as they are (the first keyframe
// is exact, so nothing is aligned).
double KeyframeError(const Map& map, const std::map<KeyframeId, Rigid3>& truth);

}  // namespace airslam
