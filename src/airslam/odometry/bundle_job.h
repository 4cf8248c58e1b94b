// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <utility>
#include <vector>

#include "airslam/map/keyframe.h"
#include "airslam/optimize/bundle.h"

namespace airslam {

// One local bundle adjustment: a copy of what it needs, and whom its parts belong to. Solving it
// touches nothing else, so it may run on another thread.
struct BundleJob {
  std::vector<KeyframeId> keyframes;     // of problem.world_from_cam
  std::vector<LandmarkId> landmarks;     // of problem.points_in_world
  std::vector<FeatureRef> observations;  // of problem.observations
  // Landmarks that only one of the keyframes sees: they say nothing about poses, and go along with
  // that keyframe.
  std::vector<std::pair<LandmarkId, KeyframeId>> carried;
  // The same of lines.
  std::vector<LandmarkId> line_landmarks;     // of problem.lines_in_world
  std::vector<FeatureRef> line_observations;  // of problem.line_observations
  std::vector<std::pair<LandmarkId, KeyframeId>> carried_lines;
  BundleProblem problem;
  BundleSummary summary;
};

}  // namespace airslam
