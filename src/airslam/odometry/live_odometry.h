// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <exception>
#include <memory>
#include <optional>
#include <thread>

#include "airslam/dataset/live_sequence.h"
#include "airslam/odometry/map_run.h"

namespace airslam {

// Odometry of a rig that is running: frames and IMU readings are added one by one, RunPipeline
// works on them on threads of its own. The result is that of the same frames and readings recorded,
// bit for bit: a frame waits for the readings that it needs, and for no others.
class LiveOdometry {
 public:
  // `observer` may be empty; it is called from another thread. Throws Error as MapRun does.
  LiveOdometry(const StereoRig& rig, const MapRunRequest& request, FrameObserver observer);
  // Without Finish() the run is given up: no result, the map so far stays in "<out>.partial".
  ~LiveOdometry();
  LiveOdometry(const LiveOdometry&) = delete;
  LiveOdometry& operator=(const LiveOdometry&) = delete;

  // See LiveSequence; these throw what ended the run, if something has. From one thread only.
  void AddImu(const ImuSample& sample);
  void AddFrame(const StereoPair& pair);
  void EndImu() { sequence_.EndImu(); }

  // Waits for the frames that are under way, and writes the results. Once only; nothing may follow.
  struct Outcome {
    PipelineResult result;
    RunInfo info;
  };
  Outcome Finish();

  MapRun& run() { return run_; }

 private:
  void Work(const FrameObserver& observer);
  [[noreturn]] void RethrowInstead();  // of what the caller is handling

  MapRun run_;
  LiveSequence sequence_;
  std::optional<PipelineResult> result_;
  std::exception_ptr error_;
  std::thread thread_;  // last
};

}  // namespace airslam
