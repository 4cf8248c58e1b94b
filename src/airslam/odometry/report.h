// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "airslam/common/stage_times.h"
#include "airslam/dataset/trajectory.h"
#include "airslam/odometry/pipeline.h"

namespace airslam {

// The word for a state in reports: "initialized", "tracked", "inertial", "lost", "skipped".
const char* StateName(FrameState state);

// The component with the most frames that have a pose (the earlier of equals); -1 without any.
int LargestComponent(const PipelineResult& result);

// world_from_body of every frame of the component, frames hanging on their optimized keyframes.
Trajectory FinalTrajectory(const PipelineResult& result, int component);
// The same as first estimated, while the run went on.
Trajectory OnlineTrajectory(const PipelineResult& result, int component);
// world_from_body of the component's keyframes.
Trajectory KeyframeTrajectory(const PipelineResult& result, int component);

// What the user is told about a run, besides the poses.
struct RunInfo {
  std::string dataset;  // path as given
  std::string model_pack;
  std::string options_yaml;  // effective values
  double wall_seconds = 0;   // of the whole process up to now
  int sequence_frames = 0;   // of the whole sequence; more than was processed when it was stopped
  std::string stopped_by;    // the signal that ended the run early; empty: none
};

// report.json: counts, frames/s, milliseconds a stage, intervals without a pose, state of every
// frame. Keys are described in docs/outputs.md.
nlohmann::json MakeReport(const PipelineResult& result, const StageTimes& times,
                          const RunInfo& info);

// Writes trajectory.tum, trajectory_online.tum, keyframes.tum and report.json into `folder`.
void WriteRunOutputs(const std::filesystem::path& folder, const PipelineResult& result,
                     const StageTimes& times, const RunInfo& info);

}  // namespace airslam
