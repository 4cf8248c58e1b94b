// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <exception>
#include <filesystem>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "airslam/common/bounded_queue.h"
#include "airslam/common/stage_times.h"
#include "airslam/map/map_file.h"

namespace airslam {

// Commits keyframes and updates to the map file on a thread of its own, in the order of the calls,
// so that the disk does not hold up tracking. Any call, Finish() at the latest, throws what writing
// has thrown (a full disk, say).
class MapRecorder {
 public:
  MapRecorder(const std::filesystem::path& file, const MapCalibration& calibration,
              const std::string& model_pack, const std::string& model_pack_sha256,
              StageTimes& times);
  ~MapRecorder();
  MapRecorder(const MapRecorder&) = delete;
  MapRecorder& operator=(const MapRecorder&) = delete;

  void AddKeyframe(Keyframe keyframe, std::vector<Landmark> new_landmarks);
  void AddLines(Keyframe keyframe, std::vector<LineLandmark> new_line_landmarks);
  void Apply(MapWriter::Update update);
  // Waits until everything is written and closes the file.
  void Finish();

 private:
  void Enqueue(std::function<void()> task);
  void Run();
  void RethrowError();

  StageTimes& times_;
  MapWriter writer_;
  BoundedQueue<std::function<void()>> tasks_{16};
  std::mutex mutex_;
  std::exception_ptr error_;
  std::thread thread_;
};

}  // namespace airslam
