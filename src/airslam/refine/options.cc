// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/refine/options.h"

#include <sstream>

#include "airslam/common/options.h"
#include "airslam/refine/map_processor.h"

namespace airslam {
namespace {

void RequirePositive(const char* name, double value) {
  RequireOption(value > 0, name, value, "must be above 0");
}

}  // namespace

void LoopClosureOptions::Validate() const {
  RequireOption(min_score_share >= 0 && min_score_share < 1, "loop_closure.min_score_share",
                min_score_share, "must be at least 0 and below 1");
  RequireOption(min_shared_in_group >= 0, "loop_closure.min_shared_in_group", min_shared_in_group,
                "must not be negative");
  RequireOption(max_groups >= 1, "loop_closure.max_groups", max_groups, "must be at least 1");
  RequireOption(min_inliers >= 6, "loop_closure.min_inliers", min_inliers, "must be at least 6");
  RequirePositive("loop_closure.pixel_sigma", pixel_sigma);
  RequirePositive("loop_closure.ransac_error", ransac_error);
  RequirePositive("loop_closure.max_disagreement", max_disagreement);
  RequirePositive("loop_closure.max_disagreement_angle", max_disagreement_angle);
  RequirePositive("loop_closure.max_drift", max_drift);
  RequirePositive("loop_closure.max_drift_angle", max_drift_angle);
  RequireOption(min_joining_loops >= 1, "loop_closure.min_joining_loops", min_joining_loops,
                "must be at least 1");
}

void MergeOptions::Validate() const {
  RequireOption(min_shared_points >= 1, "merge.min_shared_points", min_shared_points,
                "must be at least 1");
}

void PoseGraphProcessorOptions::Validate() const {
  RequireOption(iterations >= 1, "pose_graph.iterations", iterations, "must be at least 1");
  RequireOption(min_landmarks >= 0, "pose_graph.min_landmarks", min_landmarks,
                "must not be negative");
  RequirePositive("pose_graph.position_share", position_share);
  RequirePositive("pose_graph.position_sigma", position_sigma);
  RequirePositive("pose_graph.rotation_sigma", rotation_sigma);
}

void GlobalBundleOptions::Validate() const {
  RequireOption(rough_iterations >= 1, "global_bundle.rough_iterations", rough_iterations,
                "must be at least 1");
  RequireOption(fine_iterations >= 1, "global_bundle.fine_iterations", fine_iterations,
                "must be at least 1");
  RequirePositive("global_bundle.pixel_sigma", pixel_sigma);
  RequirePositive("global_bundle.revisit_sigma", revisit_sigma);
  RequirePositive("global_bundle.line_sigma", line_sigma);
  RequirePositive("global_bundle.huber", huber);
  RequirePositive("global_bundle.max_error", max_error);
}

std::vector<std::string> RefineOptions::ProcessorNames() const {
  std::vector<std::string> names;
  std::istringstream list(processors);
  for (std::string name; std::getline(list, name, ',');) {
    const std::size_t begin = name.find_first_not_of(" \t");
    const std::size_t end = name.find_last_not_of(" \t");
    if (begin != std::string::npos) names.push_back(name.substr(begin, end - begin + 1));
  }
  return names;
}

void RefineOptions::Validate() const {
  loop_closure.Validate();
  merge.Validate();
  pose_graph.Validate();
  global_bundle.Validate();
  for (const std::string& name : ProcessorNames()) MakeMapProcessor(name);
}

}  // namespace airslam
