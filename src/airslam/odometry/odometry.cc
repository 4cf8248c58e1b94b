// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/odometry.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <utility>

namespace airslam {
namespace {

int CountLandmarks(const Keyframe& keyframe) {
  return static_cast<int>(std::count_if(keyframe.landmarks.begin(), keyframe.landmarks.end(),
                                        [](LandmarkId id) { return id != kNoLandmark; }));
}

}  // namespace

Odometry::Odometry(const OdometryOptions& options, const StereoRectifier& rectifier,
                   const MapCalibration& calibration, FeatureDetector& right_detector,
                   FeatureMatcher& matcher, MapRecorder* recorder, StageTimes& times)
    : options_(options),
      rectifier_(rectifier),
      right_detector_(right_detector),
      matcher_(matcher),
      recorder_(recorder),
      times_(times),
      map_(calibration, options_.local_map, options_.tracking.pixel_sigma),
      tracker_(options_.tracking, map_, matcher_),
      builder_(options_, tracker_, map_),
      bundle_worker_({}, times) {}

const FrameRecord& Odometry::Process(const PreparedFrame& frame) {
  const auto start = std::chrono::steady_clock::now();
  if (bundle_due_ && frame.index >= *bundle_due_) TakeBundle();
  FrameRecord record;
  record.timestamp_ns = frame.timestamp_ns;
  if (frame.left.empty()) {
    record.state = FrameState::kSkipped;
  } else {
    Estimate(frame, record);
  }
  record.milliseconds =
      std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
  records_.push_back(record);
  return records_.back();
}

void Odometry::Estimate(const PreparedFrame& frame, FrameRecord& record) {
  const Pinhole& camera = map_.stereo().camera;
  const KeypointGrid grid(frame.features.keypoints, camera.width, camera.height);
  const ImagePyramid pyramid = MakePyramid(frame.left);
  const FrameView view{pyramid, frame.features, grid};
  if (map_.empty()) return Start(frame, view, record);

  std::optional<TrackedFrame> tracked;
  const bool was_lost = lost_frames_ > 0;
  {
    ScopedStage stage(times_, "track");
    if (!was_lost) {
      const Rigid3& world_from_reference =
          map_.map().keyframes.at(motion_.reference()).world_from_cam;
      tracked = tracker_.Track(view, map_.last(),
                               motion_.Predict(frame.timestamp_ns, world_from_reference));
    }
    if (!tracked) tracked = Recover(view);
  }
  if (!tracked) {
    ++lost_frames_;
    motion_.Reset();
    if (lost_frames_ > options_.recovery.lost_frames) Start(frame, view, record);
    return;
  }
  lost_frames_ = 0;
  record.state = FrameState::kTracked;
  record.component = component_;
  record.reference = tracked->keyframe;
  const Rigid3& world_from_reference = map_.map().keyframes.at(record.reference).world_from_cam;
  record.reference_from_cam = world_from_reference.Inverse() * tracked->world_from_cam;
  record.online_world_from_cam = tracked->world_from_cam;
  record.tracked_points = static_cast<int>(tracked->points.size());
  record.used_matcher = tracked->used_matcher;
  motion_.Observe(frame.timestamp_ns, record.reference, record.reference_from_cam,
                  world_from_reference);
  if (was_lost || NeedsKeyframe(*tracked)) {
    ScopedStage stage(times_, "keyframe");
    // The keyframe must start from the latest map; its own pose moves with its reference.
    if (bundle_due_) TakeBundle();
    tracked->world_from_cam =
        map_.map().keyframes.at(record.reference).world_from_cam * record.reference_from_cam;
    std::erase_if(tracked->points, [&](const TrackedPoint& point) {
      return !map_.map().landmarks.contains(point.landmark);  // an outlier by now
    });
    KeyframeDraft draft = builder_.FromTracked(view, frame.timestamp_ns, *tracked);
    MatchRight(frame, view, draft.keyframe);
    if (was_lost || IsWorthwhile(draft.keyframe, *tracked)) {
      InsertKeyframe(frame, view, std::move(draft), record);
    }
  }
}

std::optional<TrackedFrame> Odometry::Recover(const FrameView& view) const {
  const std::span<const KeyframeId> window = map_.window();
  int tries = options_.recovery.keyframes;
  for (auto id = window.rbegin(); id != window.rend() && tries > 0; ++id, --tries) {
    if (auto found = tracker_.Relocate(view, map_.map().keyframes.at(*id), options_.recovery)) {
      return found;
    }
  }
  return std::nullopt;
}

bool Odometry::NeedsKeyframe(const TrackedFrame& tracked) const {
  const int points = static_cast<int>(tracked.points.size());
  const Pinhole& camera = map_.stereo().camera;
  const double size = std::sqrt(static_cast<double>(camera.width) * camera.height);
  return points < options_.keyframe.min_tracked_share * CountLandmarks(map_.last()) ||
         points < options_.keyframe.min_tracked ||
         tracked.mean_parallax > options_.keyframe.max_parallax * size;
}

// In the dark a keyframe would hold few points and noisy patches. As long as the last one carries
// the frames, one that offers much less than it is not made.
bool Odometry::IsWorthwhile(const Keyframe& keyframe, const TrackedFrame& tracked) const {
  if (static_cast<int>(tracked.points.size()) < 2 * options_.tracking.min_tracked) return true;
  int offered = 0;
  for (std::size_t i = 0; i < keyframe.keypoints.size(); ++i) {
    offered += keyframe.landmarks[i] != kNoLandmark || keyframe.right_x[i] >= 0;
  }
  return 2 * offered >= CountLandmarks(map_.last());
}

void Odometry::MatchRight(const PreparedFrame& frame, const FrameView& view, Keyframe& keyframe) {
  const cv::Mat right = rectifier_.RectifyRight(frame.right_raw);
  Detections features;
  {
    ScopedStage stage(times_, "detect right");
    features = right_detector_.Detect(right, rectifier_.right_mask(), options_.max_keypoints);
  }
  ScopedStage stage(times_, "match stereo");
  builder_.MatchRight(view, MakePyramid(right), features, keyframe);
}

void Odometry::Start(const PreparedFrame& frame, const FrameView& view, FrameRecord& record) {
  if (bundle_due_) TakeBundle();
  // The body of a component's first keyframe is the origin of its world.
  KeyframeDraft draft = builder_.FromDetections(view, frame.timestamp_ns, component_ + 1,
                                                map_.map().calibration.body_from_left);
  const Keyframe& keyframe = draft.keyframe;
  MatchRight(frame, view, draft.keyframe);
  const auto matched = std::count_if(keyframe.right_x.begin(), keyframe.right_x.end(),
                                     [](float x) { return x >= 0; });
  if (matched < options_.recovery.min_stereo_points) return;  // the next frame may have more depth
  ++component_;
  lost_frames_ = 0;
  record.state = FrameState::kInitialized;
  record.component = component_;
  record.online_world_from_cam = keyframe.world_from_cam;
  motion_ = {};
  motion_.Observe(frame.timestamp_ns, keyframe.id, {}, keyframe.world_from_cam);
  InsertKeyframe(frame, view, std::move(draft), record);
  record.tracked_points = CountLandmarks(map_.last());
}

void Odometry::InsertKeyframe(const PreparedFrame& frame, const FrameView& view,
                              KeyframeDraft draft, FrameRecord& record) {
  Keyframe& keyframe = draft.keyframe;
  std::vector<LandmarkId> added = builder_.AddStereoLandmarks(keyframe);
  const std::vector<LandmarkId> from_motion = builder_.AddMotionLandmarks(view, keyframe);
  added.insert(added.end(), from_motion.begin(), from_motion.end());
  for (int index : draft.redefining) {
    map_.SetSource(keyframe.landmarks[index], {keyframe.id, index});
  }
  record.is_keyframe = true;
  record.reference = keyframe.id;
  record.reference_from_cam = {};
  motion_.MoveTo(keyframe.id);
  if (recorder_ != nullptr) {
    std::vector<Landmark> landmarks;
    for (LandmarkId id : added) landmarks.push_back(map_.map().landmarks.at(id));
    recorder_->AddKeyframe(keyframe, std::move(landmarks));
    if (!from_motion.empty()) {
      const Keyframe& last = map_.last();
      recorder_->Apply({.world_from_cam = {},
                        .landmarks = {},
                        .keyframe_landmarks = {{last.id, last.landmarks}},
                        .removed_landmarks = {}});
    }
  }
  map_.AddKeyframe(std::move(keyframe), view.image);
  bundle_worker_.Submit(map_.MakeBundleJob());
  bundle_due_ = frame.index + options_.local_map.lag_frames;
}

void Odometry::TakeBundle() {
  ScopedStage stage(times_, "wait for bundle");
  bundle_due_.reset();
  MapWriter::Update update = map_.Apply(bundle_worker_.Take());
  motion_.Rebase(map_.map().keyframes.at(motion_.reference()).world_from_cam);
  if (recorder_ != nullptr) recorder_->Apply(std::move(update));
}

void Odometry::Finish() {
  if (bundle_due_) TakeBundle();
}

}  // namespace airslam
