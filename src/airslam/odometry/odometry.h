// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "airslam/common/stage_times.h"
#include "airslam/neural/feature_detector.h"
#include "airslam/neural/feature_matcher.h"
#include "airslam/odometry/bundle_worker.h"
#include "airslam/odometry/frame_tracker.h"
#include "airslam/odometry/keyframe_builder.h"
#include "airslam/odometry/local_map.h"
#include "airslam/odometry/map_recorder.h"
#include "airslam/odometry/motion_model.h"
#include "airslam/odometry/options.h"
#include "airslam/sensor/rectification.h"

namespace airslam {

// A frame that is ready for tracking: the left image rectified and searched for features. The right
// image stays raw until the frame becomes a keyframe.
struct PreparedFrame {
  int index = 0;
  std::int64_t timestamp_ns = 0;
  cv::Mat left;       // rectified; empty when the frame was skipped
  cv::Mat right_raw;
  Detections features;
  std::string problem;  // why it was skipped
};

enum class FrameState {
  kInitialized,  // first keyframe of a component
  kTracked,
  kLost,     // no pose
  kSkipped,  // its images could not be used
};

// What is known of one frame. Its pose hangs on a keyframe and moves with it.
struct FrameRecord {
  std::int64_t timestamp_ns = 0;
  FrameState state = FrameState::kLost;
  int component = -1;                // -1 without a pose
  KeyframeId reference = -1;
  Rigid3 reference_from_cam;         // rectified left cameras
  Rigid3 online_world_from_cam;      // as first estimated
  int tracked_points = 0;
  bool is_keyframe = false;
  bool used_matcher = false;
  double milliseconds = 0;           // of tracking this frame

  bool has_pose() const { return component >= 0; }
};

// Stereo visual odometry, one frame at a time: tracks it against the last keyframe, makes keyframes,
// and hands them to local bundle adjustment. When lost it tries the last keyframes and then starts
// a new component. The same frames give the same result, bit by bit.
class Odometry {
 public:
  // `recorder` may be null. The references must outlive the object.
  Odometry(const OdometryOptions& options, const StereoRectifier& rectifier,
           const MapCalibration& calibration, FeatureDetector& right_detector,
           FeatureMatcher& matcher, MapRecorder* recorder, StageTimes& times);

  // Frames come in order of time.
  const FrameRecord& Process(const PreparedFrame& frame);

  // Takes the last bundle adjustment. No frame may follow.
  void Finish();

  const std::vector<FrameRecord>& records() const { return records_; }
  const Map& map() const { return map_.map(); }

 private:
  void Estimate(const PreparedFrame& frame, FrameRecord& record);
  void Start(const PreparedFrame& frame, const FrameView& view, FrameRecord& record);
  std::optional<TrackedFrame> Recover(const FrameView& view) const;
  bool NeedsKeyframe(const TrackedFrame& tracked) const;
  bool IsWorthwhile(const Keyframe& keyframe, const TrackedFrame& tracked) const;
  void MatchRight(const PreparedFrame& frame, const FrameView& view, Keyframe& keyframe);
  void InsertKeyframe(const PreparedFrame& frame, const FrameView& view, KeyframeDraft draft,
                      FrameRecord& record);
  void TakeBundle();

  const OdometryOptions options_;
  const StereoRectifier& rectifier_;
  FeatureDetector& right_detector_;
  FeatureMatcher& matcher_;
  MapRecorder* recorder_;
  StageTimes& times_;

  LocalMap map_;
  FrameTracker tracker_;
  KeyframeBuilder builder_;
  MotionModel motion_;
  std::vector<FrameRecord> records_;
  int component_ = -1;
  int lost_frames_ = 0;
  std::optional<int> bundle_due_;  // index of the frame from which on the result is used
  BundleWorker bundle_worker_;     // last: its thread ends first
};

}  // namespace airslam
