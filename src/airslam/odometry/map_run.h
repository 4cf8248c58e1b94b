// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "airslam/common/atomic_directory.h"
#include "airslam/common/stage_times.h"
#include "airslam/neural/feature_matcher.h"
#include "airslam/neural/model_pack.h"
#include "airslam/neural/plnet.h"
#include "airslam/odometry/map_recorder.h"
#include "airslam/odometry/options.h"
#include "airslam/odometry/pipeline.h"
#include "airslam/odometry/report.h"
#include "airslam/sensor/rectification.h"
#include "airslam/sensor/rig.h"

namespace airslam {

// What is asked of a run from stereo images to a map.
struct MapRunRequest {
  std::string dataset;  // what the images are, for the report
  // Folder of results, which appears as a whole at the end (AtomicDirectory); empty: no files.
  std::filesystem::path out;
  OdometryOptions options;
  std::string model_pack = kDefaultModelPack;  // a name or a folder
};

// Everything that a run needs besides its frames: rectification, networks, the folder of results
// and the map file in it. The program and the Python package both make their maps with it.
class MapRun {
 public:
  // Throws Error when the options are wrong, the rig cannot be rectified, the pack cannot be read,
  // a network does not fit or the folder cannot be written.
  MapRun(const StereoRig& rig, const MapRunRequest& request);

  const StereoRectifier& rectifier() const { return rectifier_; }
  const OdometryOptions& options() const { return request_.options; }
  PipelineNetworks networks() { return {detector_, line_detector_, *matcher_}; }
  MapRecorder* recorder() { return recorder_ ? &*recorder_ : nullptr; }  // null without a folder
  StageTimes& times() { return times_; }

  // Ends the run: writes what is left of the results (report.h) and puts the folder in its place.
  // The recorder must have finished. `sequence_frames`: how many frames there were to process;
  // `stopped_by`: the signal that ended the run before the last of them. Returns what the report
  // says of the run.
  RunInfo Commit(const PipelineResult& result, int sequence_frames,
                 const std::string& stopped_by = {});

 private:
  std::unique_ptr<FeatureMatcher> LoadNetworks();

  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  const MapRunRequest request_;
  const StereoRig rig_;
  const StereoRectifier rectifier_;
  const ModelPack pack_;
  PlNet detector_, line_detector_;
  const std::unique_ptr<FeatureMatcher> matcher_;
  StageTimes times_;
  std::optional<AtomicDirectory> out_;
  std::optional<MapRecorder> recorder_;  // after what it uses
};

}  // namespace airslam
