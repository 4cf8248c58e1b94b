// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/evaluate/error_json.h"

#include <numbers>

namespace airslam {
namespace {

nlohmann::json ToJson(const ErrorStatistics& s, double factor) {
  return {{"rmse", factor * s.rmse},
          {"mean", factor * s.mean},
          {"median", factor * s.median},
          {"max", factor * s.max},
          {"count", s.count}};
}

}  // namespace

nlohmann::json ToJson(const TrajectoryErrors& errors) {
  constexpr double kDegrees = 180 / std::numbers::pi;
  return {{"alignment", ToString(errors.options.alignment)},
          {"scale", errors.groundtruth_from_estimate.scale},
          {"max_time_difference_s", errors.options.max_time_difference},
          {"groundtruth_poses", errors.groundtruth_poses},
          {"estimated_poses", errors.estimated_poses},
          {"compared_poses", errors.compared_poses},
          {"duration_s", errors.duration},
          {"path_length_m", errors.path_length},
          {"coverage", errors.coverage},
          {"coverage_frames", errors.coverage_frames},
          {"coverage_basis", errors.coverage_basis},
          {"ate_position_m", ToJson(errors.position, 1)},
          {"rpe_delta_frames", errors.options.rpe_delta},
          {"rpe_translation_m", ToJson(errors.relative_translation, 1)},
          {"rpe_rotation_deg", ToJson(errors.relative_rotation, kDegrees)}};
}

}  // namespace airslam
