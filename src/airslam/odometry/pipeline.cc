// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/pipeline.h"

#include <exception>
#include <memory>
#include <optional>
#include <thread>
#include <utility>

#include "airslam/common/bounded_queue.h"
#include "airslam/common/error.h"
#include "airslam/common/log.h"

namespace airslam {
namespace {

using FrameQueue = BoundedQueue<PreparedFrame>;

// Runs a stage on a thread of its own. When it ends, by return or by throwing, the queue that it
// fills is closed, so that the stage behind it ends too.
class StageThread {
 public:
  template <typename Body>
  StageThread(FrameQueue& output, Body body)
      : output_(output), thread_([this, body = std::move(body)] {
          try {
            body();
          } catch (...) {
            error_ = std::current_exception();
          }
          output_.Close();
        }) {}

  ~StageThread() {
    output_.Close();
    if (thread_.joinable()) thread_.join();
  }
  StageThread(const StageThread&) = delete;
  StageThread& operator=(const StageThread&) = delete;

  // Waits for the stage's end and rethrows what it threw.
  void Join() {
    thread_.join();
    if (error_) std::rethrow_exception(error_);
  }

 private:
  FrameQueue& output_;
  std::exception_ptr error_;
  std::thread thread_;
};

// Wakes the reader of a sequence that waits when the run ends, also by throwing.
struct Abandoner {
  const Sequence& sequence;
  ~Abandoner() { sequence.Abandon(); }
};

PreparedFrame ReadFrame(const Sequence& sequence, int index, const StereoRectifier& rectifier,
                        StageTimes& times) {
  PreparedFrame frame;
  frame.index = index;
  frame.timestamp_ns = sequence.timestamp_ns(index);
  try {
    StereoPair pair;
    {
      ScopedStage stage(times, "read");
      pair = sequence.Read(index);
    }
    ScopedStage stage(times, "rectify left");
    frame.left = rectifier.RectifyLeft(pair.left);
    frame.right_raw = pair.right;
  } catch (const Error& error) {
    frame.problem = error.what();
  }
  return frame;
}

// Nothing without an IMU; `summary` then says why.
std::unique_ptr<InertialOdometry> MakeInertial(const Sequence& sequence,
                                               const StereoRectifier& rectifier,
                                               const InertialOptions& options,
                                               InertialSummary& summary) {
  if (!options.enabled) {
    summary.reason = "switched off";
  } else if (!sequence.rig().imu) {
    summary.state = "no calibration";
    summary.reason = "the calibration has no IMU";
  } else if (sequence.imu().empty() && !sequence.has_more_imu()) {
    summary.state = "no readings";
    summary.reason = "the sequence has no IMU readings";
  } else {
    ImuSource more;
    if (sequence.has_more_imu()) {
      more = [&sequence](std::int64_t until_ns) { return sequence.MoreImu(until_ns); };
    }
    return std::make_unique<InertialOdometry>(options, sequence.imu(), *sequence.rig().imu,
                                              sequence.rig().imu_time_offset,
                                              rectifier.body_from_left(), std::move(more));
  }
  return nullptr;
}

}  // namespace

MapCalibration MakeMapCalibration(const StereoRig& rig, const StereoRectifier& rectifier) {
  return {rectifier.stereo(), rectifier.body_from_left(), rig.imu.has_value()};
}

PipelineResult RunPipeline(const Sequence& sequence, const StereoRectifier& rectifier,
                           const OdometryOptions& options, const PipelineNetworks& networks,
                           MapRecorder* recorder, const FrameObserver& observer, StageTimes& times,
                           const std::atomic<bool>* stop) {
  FrameQueue prepared_frames(2);
  StageThread reader(prepared_frames, [&] {
    for (int i = 0; !(stop != nullptr && *stop) && sequence.Has(i); ++i) {
      if (!prepared_frames.Push(ReadFrame(sequence, i, rectifier, times))) return;
    }
  });

  const Abandoner abandoner{sequence};
  InertialSummary without_imu;
  const auto inertial = MakeInertial(sequence, rectifier, options.inertial, without_imu);
  Odometry odometry(options, MakeMapCalibration(sequence.rig(), rectifier),
                    {rectifier, networks.detector, networks.line_detector, networks.matcher,
                     recorder, inertial.get(), times});
  while (std::optional<PreparedFrame> frame = prepared_frames.Pop()) {
    if (!frame->problem.empty()) LogWarn("frame {} skipped: {}", frame->index, frame->problem);
    const FrameObservation seen = odometry.Process(*frame);
    if (observer) observer(seen);
  }
  sequence.Abandon();  // where a stage has failed the reader may still wait for a frame
  reader.Join();
  odometry.Finish();
  if (recorder != nullptr) recorder->Finish();
  return {odometry.records(), odometry.map(), inertial ? inertial->summary() : without_imu};
}

}  // namespace airslam
