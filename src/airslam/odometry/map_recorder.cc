// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/map_recorder.h"

#include <utility>

namespace airslam {

MapRecorder::MapRecorder(const std::filesystem::path& file, const MapCalibration& calibration,
                         const std::string& model_pack, const std::string& model_pack_sha256,
                         StageTimes& times)
    : times_(times),
      writer_(file, calibration, model_pack, model_pack_sha256),
      thread_([this] { Run(); }) {}

MapRecorder::~MapRecorder() {
  tasks_.Close();
  if (thread_.joinable()) thread_.join();
}

void MapRecorder::AddKeyframe(Keyframe keyframe, std::vector<Landmark> new_landmarks) {
  Enqueue([this, keyframe = std::move(keyframe), landmarks = std::move(new_landmarks)] {
    writer_.AddKeyframe(keyframe, landmarks);
  });
}

void MapRecorder::AddLines(Keyframe keyframe, std::vector<LineLandmark> new_line_landmarks) {
  Enqueue([this, keyframe = std::move(keyframe), landmarks = std::move(new_line_landmarks)] {
    writer_.AddLines(keyframe, landmarks);
  });
}

void MapRecorder::Apply(MapWriter::Update update) {
  Enqueue([this, update = std::move(update)] { writer_.Apply(update); });
}

void MapRecorder::Finish() {
  tasks_.Close();
  if (thread_.joinable()) thread_.join();
  RethrowError();
  writer_.Close();
}

void MapRecorder::Enqueue(std::function<void()> task) {
  RethrowError();
  tasks_.Push(std::move(task));
}

void MapRecorder::RethrowError() {
  std::lock_guard lock(mutex_);
  if (error_) std::rethrow_exception(error_);
}

void MapRecorder::Run() {
  while (std::optional<std::function<void()>> task = tasks_.Pop()) {
    try {
      ScopedStage stage(times_, "write map");
      (*task)();
    } catch (...) {
      std::lock_guard lock(mutex_);
      if (!error_) error_ = std::current_exception();
      tasks_.Close();
      return;
    }
  }
}

}  // namespace airslam
