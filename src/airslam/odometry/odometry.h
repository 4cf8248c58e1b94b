// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <future>
#include <opencv2/core.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "airslam/common/stage_times.h"
#include "airslam/neural/feature_detector.h"
#include "airslam/neural/feature_matcher.h"
#include "airslam/odometry/bundle_worker.h"
#include "airslam/odometry/frame_record.h"
#include "airslam/odometry/frame_tracker.h"
#include "airslam/odometry/inertial_odometry.h"
#include "airslam/odometry/keyframe_builder.h"
#include "airslam/odometry/line_builder.h"
#include "airslam/odometry/line_search.h"
#include "airslam/odometry/local_map.h"
#include "airslam/odometry/map_recorder.h"
#include "airslam/odometry/motion_model.h"
#include "airslam/odometry/options.h"
#include "airslam/sensor/rectification.h"

namespace airslam {

// A frame that is ready for tracking: the left image rectified. The right image stays raw until the
// frame becomes a keyframe.
struct PreparedFrame {
  int index = 0;
  std::int64_t timestamp_ns = 0;
  cv::Mat left;  // rectified; empty when the frame was skipped
  cv::Mat right_raw;
  std::string problem;  // why it was skipped
};

// All that is known of a frame right after it was tracked. It lives until the next one is.
struct FrameObservation {
  const PreparedFrame& prepared;
  const FrameRecord& record;
  // The landmarks that hold its pose, record.tracked_points of them, and where the left image shows
  // them.
  std::span<const TrackedPoint> points;
  // What was detected in the left image; null where it was tracked without.
  const Detections* features = nullptr;
  // What it became, if it became one: as it was made, before any bundle adjustment with it, and
  // without lines yet.
  const Keyframe* keyframe = nullptr;
  // The keyframe before it, which has its lines by now (docs/odometry.md); null with most frames.
  const Keyframe* lined = nullptr;
  // The IMU's part, once it is initialised and the frame has a pose, in the world of its component.
  std::optional<InertialEstimate> inertial = {};
};

// Stereo visual odometry, one frame at a time: tracks it against the last keyframe, makes
// keyframes, with lines if the detector finds them, and hands them to local bundle adjustment. When
// lost it tries the last keyframes and then starts a new component. With an inertial side, the IMU
// predicts the frames and carries those that vision loses. The same frames give the same result,
// bit by bit.
class Odometry {
 public:
  // What it works with. `recorder` and `inertial` may be null. The references must outlive it.
  struct Parts {
    const StereoRectifier& rectifier;
    FeatureDetector& detector;
    FeatureDetector& line_detector;  // of the same networks; works beside it on another thread
    FeatureMatcher& matcher;
    MapRecorder* recorder;
    InertialOdometry* inertial;
    StageTimes& times;
  };
  Odometry(const OdometryOptions& options, const MapCalibration& calibration, const Parts& parts);

  // Frames come in order of time.
  FrameObservation Process(const PreparedFrame& frame);

  // Takes the last bundle adjustment; where gravity is known, turns the world so that z points up.
  // No frame may follow.
  void Finish();

  const std::vector<FrameRecord>& records() const { return records_; }
  const Map& map() const { return map_.map(); }

 private:
  void Estimate(const PreparedFrame& frame, FrameRecord& record);
  FrameObservation Observe(const PreparedFrame& frame) const;
  // Finds the frame by vision; `inertial` is where the IMU expects it.
  std::optional<TrackedFrame> Find(const PreparedFrame& frame, const FrameView& view,
                                   const std::optional<PosePrior>& inertial) const;
  std::optional<TrackedFrame> TrackNear(const FrameView& view, const PosePrior& inertial) const;
  std::optional<TrackedFrame> Recover(const FrameView& view) const;
  // What becomes of a frame that vision has found, or has not.
  void Hit(const PreparedFrame& frame, const FrameView& view, TrackedFrame& tracked,
           FrameRecord& record);
  void Miss(const PreparedFrame& frame, const FrameView& view, FrameRecord& record);
  // A keyframe that knows no landmark yet: of a new component, or of the current one where only the
  // IMU says its pose.
  void Start(const PreparedFrame& frame, const FrameView& view, FrameRecord& record);
  void Continue(const PreparedFrame& frame, const FrameView& view, FrameRecord& record);
  std::optional<KeyframeDraft> DraftAnew(const PreparedFrame& frame, const FrameView& view,
                                         int component, const Rigid3& world_from_cam);
  void Begin(const PreparedFrame& frame, const FrameView& view, KeyframeDraft draft,
             FrameRecord& record);
  VisualPose ToVisualPose(const TrackedFrame& tracked) const;
  bool NeedsKeyframe(const TrackedFrame& tracked) const;
  bool IsWorthwhile(const Keyframe& keyframe, const TrackedFrame& tracked) const;
  // Whether keyframes get lines.
  bool UsesLines() const { return options_.lines.enabled && detector_.finds_lines(); }
  Detections DetectLeft(const PreparedFrame& frame) const;
  // The right image of a keyframe, rectified on another thread.
  std::future<ImagePyramid> PrepareRight(const PreparedFrame& frame) const;
  void MatchRight(const FrameView& view, std::future<ImagePyramid> right,
                  KeyframeDraft& draft) const;
  // Commits a keyframe that is not in the map yet, and what it changed there.
  void Record(const Keyframe& keyframe, std::span<const LandmarkId> added, bool last_sees_more);
  void InsertKeyframe(const PreparedFrame& frame, const FrameView& view, KeyframeDraft draft,
                      FrameRecord& record);
  void TakeBundle();
  // Gives the last keyframe its lines, and the map and the recorder what they show.
  void TakeLines();

  const OdometryOptions options_;
  const StereoRectifier& rectifier_;
  FeatureDetector& detector_;
  FeatureMatcher& matcher_;
  MapRecorder* recorder_;
  InertialOdometry* inertial_;
  StageTimes& times_;

  LocalMap map_;
  FrameTracker tracker_;
  KeyframeBuilder builder_;
  LineBuilder line_builder_;
  LineSearch line_search_;
  MotionModel motion_;
  std::vector<FrameRecord> records_;
  std::optional<FrameFeatures> features_;  // of the latest frame
  std::vector<TrackedPoint> points_;       // of the latest frame, those that hold its pose
  std::optional<KeyframeId> lined_;        // the keyframe that the latest frame gave its lines
  int component_ = -1;
  int lost_frames_ = 0;     // since vision last found one
  int strange_frames_ = 0;  // of these, the latest that show enough but nothing that is known
  std::optional<int> bundle_due_;  // index of the frame from which on the result is used
  BundleWorker bundle_worker_;     // last: its thread ends first
};

}  // namespace airslam
