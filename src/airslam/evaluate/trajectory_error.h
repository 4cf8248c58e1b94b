// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "airslam/dataset/trajectory.h"
#include "airslam/geometry/alignment.h"

namespace airslam {

enum class TrajectoryAlignment { kNone, kSe3, kSim3 };

// "SE(3)", "Sim(3)" or "none".
std::string ToString(TrajectoryAlignment alignment);

struct EvaluationOptions {
  // How the estimate is moved onto the ground truth before positions are compared. Sim(3) also
  // scales it, which only a monocular system may ask for.
  TrajectoryAlignment alignment = TrajectoryAlignment::kSe3;
  // Poses are compared with the ground truth nearest in time, at most this far away. As evo does.
  double max_time_difference = 0.01;  // s
  // Relative errors are taken between every `rpe_delta`-th compared pose and the next such one.
  int rpe_delta = 1;  // frames
};

struct ErrorStatistics {
  double rmse = 0, mean = 0, median = 0, max = 0;
  int count = 0;
};

struct TrajectoryErrors {
  EvaluationOptions options;
  Similarity3 groundtruth_from_estimate;  // the alignment
  ErrorStatistics position;               // ATE, m
  ErrorStatistics relative_translation;   // RPE, m; count 0 when there are too few poses
  ErrorStatistics relative_rotation;      // RPE, rad
  double path_length = 0;                 // m, of the compared ground truth
  double duration = 0;                    // s, of the compared ground truth

  int groundtruth_poses = 0;
  int estimated_poses = 0;
  int compared_poses = 0;

  // The share of frames that could have been estimated and were. 0 to 1.
  double coverage = 0;
  int coverage_frames = 0;     // how many could have been
  std::string coverage_basis;  // what these are, in words
};

// Indices of poses of the same time.
struct PosePair {
  int groundtruth = 0;
  int estimate = 0;
};

// Pairs each pose of the shorter trajectory with that of the longer one nearest in time, unless it
// is further away than `max_difference` seconds (as evo's sync module). Both sorted by time.
std::vector<PosePair> AssociateByTime(const Trajectory& groundtruth, const Trajectory& estimate,
                                      double max_difference);

// Compares an estimate with the ground truth of the same body. `frame_times` are the times of all
// frames of the dataset, if known: the coverage then counts those with ground truth. Else it counts
// ground-truth poses, or, where these come more often than the estimates, the frames that fit into
// the ground truth's time at the estimate's median rate.
//
// Position errors equal evo_ape (-a, -as or neither), relative ones evo_rpe with its default
// settings (`--delta N --delta_unit f`, without all pairs); the scale of Sim(3) applies to both.
// Throws Error when no pose can be compared or the alignment is not determined.
TrajectoryErrors EvaluateTrajectory(const Trajectory& groundtruth, const Trajectory& estimate,
                                    const EvaluationOptions& options = {},
                                    const std::vector<std::int64_t>& frame_times = {});

}  // namespace airslam
