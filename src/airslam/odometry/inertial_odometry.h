// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "airslam/map/map.h"
#include "airslam/odometry/frame_record.h"
#include "airslam/odometry/inertial_filter.h"
#include "airslam/odometry/inertial_options.h"
#include "airslam/odometry/inertial_summary.h"
#include "airslam/odometry/local_map.h"
#include "airslam/optimize/inertial_initialization.h"
#include "airslam/sensor/imu_buffer.h"

namespace airslam {

// Hands over readings that come while the run goes on: see Sequence::MoreImu.
using ImuSource = std::function<std::vector<ImuSample>(std::int64_t until_ns)>;

// What the IMU knows of a frame, in the world of its component before the final turn.
struct InertialEstimate {
  Eigen::Vector3d velocity_in_world;  // of the body, m/s
  ImuBias bias;                       // rad/s, m/s^2
  Eigen::Vector3d gravity_in_world;   // m/s^2, downwards
};

// The inertial side of the odometry. It keeps trying to find gravity, velocities and biases from
// the frames since the component's start, at rest or in motion; from then on it predicts the
// camera's pose, adds its factors to local bundle adjustment, and carries the frames that vision
// loses. Where it cannot (no readings, no excitation) the odometry goes on as stereo, and summary()
// says why. Not thread-safe; deterministic.
class InertialOdometry {
 public:
  // The readings in the IMU's own time, `time_offset` as in ImuBufferOptions. body_from_cam: of the
  // rectified left camera. `more`, where readings come with time: it is asked for those that a
  // frame needs, up to the frame's time and a little further when the time offset is searched.
  InertialOdometry(const InertialOptions& options, const std::vector<ImuSample>& samples,
                   const ImuNoise& noise, double time_offset, const Rigid3& body_from_cam,
                   ImuSource more = nullptr);

  // A new component begins: nothing is known of its gravity.
  void StartComponent(int component, std::int64_t timestamp_ns);

  bool initialized() const { return start_.has_value(); }
  // The camera's pose at the last frame. Only once initialised.
  Rigid3 world_from_cam() const { return filter_->world_from_cam(); }

  // Of the last frame, when it is that of this time; nothing while not initialised.
  std::optional<InertialEstimate> EstimateAt(std::int64_t timestamp_ns) const;

  // The pose expected at a frame after the last one; nothing while not initialised or without
  // readings in between.
  std::optional<PosePrior> Predict(std::int64_t timestamp_ns);

  // Ends a frame: vision found it,
  void Observe(std::int64_t timestamp_ns, const VisualPose& seen);
  // or did not, and Predict()'s pose stands in. Nothing when it is no longer good enough.
  std::optional<Rigid3> Coast();

  // Bundle adjustment has moved the map, and the last frame with it by `change`
  // (new_world_from_old_world there). `latest`: the latest keyframe, as it is now.
  void Rebase(const Rigid3& change, const Keyframe& latest);

  // Writes velocity and biases into a keyframe made of the last frame, and the readings since the
  // component's keyframe before it.
  void FillKeyframe(Keyframe& keyframe);
  // Adds the inertial terms of the job's keyframes.
  void AddTo(BundleJob& job, const Map& map);

  // The readings of keyframes whose time offset was found to be wrong after they were filled, as
  // they should be; `map` takes them over too.
  std::vector<MapWriter::Update::ImuReadings> CorrectReadings(Map& map);

  // Tries to initialise, or to improve gravity while it is not known well, when it is time to.
  // Afterwards the component's keyframes have velocities and biases.
  void TryInitialize(std::span<const FrameRecord> records, Map& map);

  // Frames that vision lost, integrated again between their final keyframes.
  void SmoothCoastedFrames(std::span<FrameRecord> records, const Map& map) const;

  // What happened so far.
  InertialSummary summary() const;

 private:
  // Takes in the readings up to a time of the images and `margin` seconds beyond.
  void Fetch(std::int64_t timestamp_ns, double margin);
  std::optional<ImuPreintegration> Readings(std::int64_t begin_ns, std::int64_t end_ns,
                                            const ImuBias& bias) const;
  std::shared_ptr<const ImuPreintegration> Link(const Keyframe& from, const Keyframe& to);
  bool IsDue(std::int64_t timestamp_ns) const;
  std::vector<InertialFrame> StartFrames(std::span<const FrameRecord> records,
                                         const Map& map) const;
  bool CorrectTimeOffset(const InertialInitialization& result);
  void Refused(const InertialInitialization& result, std::int64_t timestamp_ns);
  void Accept(const InertialInitialization& result, const std::vector<InertialFrame>& frames,
              Map& map);
  void FillKeyframes(const InertialInitialization& result, const InertialFrame& newest, Map& map);
  void FillReadings(std::int64_t begin_ns, Keyframe& keyframe) const;
  void NoteGap(std::int64_t begin_ns, std::int64_t end_ns);

  struct KnownBias {
    ImuBias mean;
    Matrix6d covariance;
  };

  const InertialOptions options_;
  const ImuNoise noise_;
  const Rigid3 body_from_cam_;
  ImuBuffer imu_;
  const ImuSource more_;
  int offset_corrections_ = 0;
  bool readings_outdated_ = false;  // keyframes hold readings with an earlier time offset
  std::optional<std::int64_t> last_keyframe_ns_;  // of the component

  int component_ = -1;
  std::int64_t component_begin_ns_ = 0, frames_begin_ns_ = 0, last_try_ns_ = 0;
  bool said_why_ = false;                    // the log knows why this component has no IMU yet
  std::optional<InertialStart> start_;       // of the current component
  std::optional<InertialFilter> filter_;     // at the last frame
  std::optional<InertialFilter> predicted_;  // at the current one
  std::int64_t last_seen_ns_ = 0;            // the last frame that vision found
  std::map<KeyframeId, KnownBias> biases_;   // of keyframes, from before they were bundled
  std::map<KeyframeId, std::shared_ptr<const ImuPreintegration>> links_;  // by the later keyframe
  InertialSummary summary_;
};

}  // namespace airslam
