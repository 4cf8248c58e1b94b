// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/evaluate/trajectory_error.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "airslam/common/error.h"
#include "airslam/geometry/so3.h"

namespace airslam {
namespace {

constexpr double kNsPerSecond = 1e9;

std::int64_t ToNs(double seconds) { return std::llround(seconds * kNsPerSecond); }

// Index of the pose nearest in time; the earlier one of two equally near. `sorted` not empty.
int Nearest(const Trajectory& sorted, std::int64_t time) {
  const auto later =
      std::lower_bound(sorted.begin(), sorted.end(), time,
                       [](const StampedPose& a, std::int64_t t) { return a.timestamp_ns < t; });
  if (later == sorted.begin()) return 0;
  const auto earlier = later - 1;
  const bool take_later =
      later != sorted.end() && later->timestamp_ns - time < time - earlier->timestamp_ns;
  return static_cast<int>((take_later ? later : earlier) - sorted.begin());
}

bool HasNear(const Trajectory& sorted, std::int64_t time, std::int64_t tolerance) {
  return std::llabs(sorted[Nearest(sorted, time)].timestamp_ns - time) <= tolerance;
}

double Median(std::vector<double> values) {
  const std::size_t middle = values.size() / 2;
  std::nth_element(values.begin(), values.begin() + middle, values.end());
  if (values.size() % 2 == 1) return values[middle];
  return 0.5 * (values[middle] + *std::max_element(values.begin(), values.begin() + middle));
}

ErrorStatistics Statistics(const std::vector<double>& errors) {
  ErrorStatistics statistics;
  if (errors.empty()) return statistics;
  double sum = 0, squares = 0;
  for (const double error : errors) {
    sum += error;
    squares += error * error;
    statistics.max = std::max(statistics.max, error);
  }
  statistics.count = static_cast<int>(errors.size());
  statistics.mean = sum / statistics.count;
  statistics.rmse = std::sqrt(squares / statistics.count);
  statistics.median = Median(errors);
  return statistics;
}

// Median time between two poses in seconds; 0 with fewer than two.
double MedianPeriod(const Trajectory& trajectory) {
  std::vector<double> periods;
  for (std::size_t i = 1; i < trajectory.size(); ++i) {
    periods.push_back((trajectory[i].timestamp_ns - trajectory[i - 1].timestamp_ns) / kNsPerSecond);
  }
  return periods.empty() ? 0 : Median(std::move(periods));
}

[[noreturn]] void FailWithoutCommonTimes(const Trajectory& groundtruth, const Trajectory& estimate,
                                         double max_difference) {
  const auto seconds = [](const StampedPose& pose) { return pose.timestamp_ns / kNsPerSecond; };
  Fail(
      "the two trajectories share no times: the ground truth runs from {:.3f} s to {:.3f} s, the "
      "estimate from {:.3f} s to {:.3f} s, and no two poses are within {} s",
      seconds(groundtruth.front()), seconds(groundtruth.back()), seconds(estimate.front()),
      seconds(estimate.back()), max_difference);
}

Similarity3 Align(const std::vector<Rigid3>& truth, const std::vector<Rigid3>& estimate,
                  TrajectoryAlignment alignment) {
  if (alignment == TrajectoryAlignment::kNone) return {};
  std::vector<Eigen::Vector3d> from, to;
  for (const Rigid3& pose : estimate) from.push_back(pose.translation);
  for (const Rigid3& pose : truth) to.push_back(pose.translation);
  const auto aligned = AlignPoints(from, to, alignment == TrajectoryAlignment::kSim3);
  if (!aligned) {
    Fail(
        "the {} alignment is not determined by the {} compared poses (it needs three that do not "
        "lie on one line); --no-align compares without",
        ToString(alignment), truth.size());
  }
  return *aligned;
}

void AddRelativeErrors(const std::vector<Rigid3>& truth, const std::vector<Rigid3>& estimate,
                       TrajectoryErrors* errors) {
  std::vector<double> translations, rotations;
  const std::size_t delta = errors->options.rpe_delta;
  for (std::size_t i = 0; i + delta < truth.size(); i += delta) {
    const Rigid3 true_motion = truth[i].Inverse() * truth[i + delta];
    const Rigid3 motion = estimate[i].Inverse() * estimate[i + delta];
    const Rigid3 error = true_motion.Inverse() * motion;
    translations.push_back(error.translation.norm());
    rotations.push_back(LogSO3(error.rotation).norm());
  }
  errors->relative_translation = Statistics(translations);
  errors->relative_rotation = Statistics(rotations);
}

void AddCoverage(const Trajectory& groundtruth, const Trajectory& estimate,
                 const std::vector<std::int64_t>& frame_times, TrajectoryErrors* errors) {
  const std::int64_t tolerance = ToNs(errors->options.max_time_difference);
  int covered = errors->compared_poses;
  if (!frame_times.empty()) {
    covered = 0;
    for (const std::int64_t time : frame_times) {
      if (!HasNear(groundtruth, time, tolerance)) continue;
      ++errors->coverage_frames;
      if (HasNear(estimate, time, tolerance)) ++covered;
    }
    errors->coverage_basis = "frames of the dataset that have ground truth";
  } else if (const double period = MedianPeriod(estimate);
             MedianPeriod(groundtruth) < 0.75 * period) {
    const std::int64_t span = groundtruth.back().timestamp_ns - groundtruth.front().timestamp_ns;
    errors->coverage_frames = 1 + static_cast<int>(span / kNsPerSecond / period + 0.01);
    errors->coverage_basis =
        "frames at the estimate's median rate in the time of the ground truth, which is denser";
  } else {
    errors->coverage_frames = static_cast<int>(groundtruth.size());
    errors->coverage_basis = "poses of the ground truth";
  }
  if (errors->coverage_frames > 0) {
    errors->coverage = std::min(1.0, static_cast<double>(covered) / errors->coverage_frames);
  }
}

}  // namespace

std::string ToString(TrajectoryAlignment alignment) {
  switch (alignment) {
    case TrajectoryAlignment::kSe3:
      return "SE(3)";
    case TrajectoryAlignment::kSim3:
      return "Sim(3)";
    case TrajectoryAlignment::kNone:
      break;
  }
  return "none";
}

std::vector<PosePair> AssociateByTime(const Trajectory& groundtruth, const Trajectory& estimate,
                                      double max_difference) {
  std::vector<PosePair> pairs;
  if (groundtruth.empty() || estimate.empty()) return pairs;
  const bool groundtruth_is_longer = groundtruth.size() > estimate.size();
  const Trajectory& shorter = groundtruth_is_longer ? estimate : groundtruth;
  const Trajectory& longer = groundtruth_is_longer ? groundtruth : estimate;
  const std::int64_t tolerance = ToNs(max_difference);
  for (int i = 0; i < static_cast<int>(shorter.size()); ++i) {
    const int j = Nearest(longer, shorter[i].timestamp_ns);
    if (std::llabs(longer[j].timestamp_ns - shorter[i].timestamp_ns) > tolerance) continue;
    pairs.push_back(groundtruth_is_longer ? PosePair{j, i} : PosePair{i, j});
  }
  return pairs;
}

TrajectoryErrors EvaluateTrajectory(const Trajectory& groundtruth, const Trajectory& estimate,
                                    const EvaluationOptions& options,
                                    const std::vector<std::int64_t>& frame_times) {
  if (options.rpe_delta < 1) Fail("the delta of relative errors must be at least 1 frame");
  if (!(options.max_time_difference >= 0)) Fail("the largest time difference must not be negative");
  if (groundtruth.empty() || estimate.empty()) Fail("a trajectory without poses can't be compared");
  const auto pairs = AssociateByTime(groundtruth, estimate, options.max_time_difference);
  if (pairs.empty()) FailWithoutCommonTimes(groundtruth, estimate, options.max_time_difference);

  TrajectoryErrors errors;
  errors.options = options;
  errors.groundtruth_poses = static_cast<int>(groundtruth.size());
  errors.estimated_poses = static_cast<int>(estimate.size());
  errors.compared_poses = static_cast<int>(pairs.size());

  std::vector<Rigid3> truth, estimated;
  for (const PosePair& pair : pairs) {
    truth.push_back(groundtruth[pair.groundtruth].world_from_body);
    estimated.push_back(estimate[pair.estimate].world_from_body);
  }
  errors.groundtruth_from_estimate = Align(truth, estimated, options.alignment);
  std::vector<double> distances;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    estimated[i] = errors.groundtruth_from_estimate.Apply(estimated[i]);
    distances.push_back((estimated[i].translation - truth[i].translation).norm());
    if (i > 0) errors.path_length += (truth[i].translation - truth[i - 1].translation).norm();
  }
  errors.position = Statistics(distances);
  errors.duration = (groundtruth[pairs.back().groundtruth].timestamp_ns -
                     groundtruth[pairs.front().groundtruth].timestamp_ns) /
                    kNsPerSecond;
  AddRelativeErrors(truth, estimated, &errors);
  AddCoverage(groundtruth, estimate, frame_times, &errors);
  return errors;
}

}  // namespace airslam
