// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/odometry.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <future>
#include <utility>

#include "airslam/odometry/upright.h"
#include "airslam/optimize/pose_parameter.h"

namespace airslam {
namespace {

int CountLandmarks(const Keyframe& keyframe) {
  return static_cast<int>(std::count_if(keyframe.landmarks.begin(), keyframe.landmarks.end(),
                                        [](LandmarkId id) { return id != kNoLandmark; }));
}

// The landmarks of a keyframe as points that it tracks.
std::vector<TrackedPoint> OwnPoints(const Keyframe& keyframe) {
  std::vector<TrackedPoint> points;
  for (std::size_t i = 0; i < keyframe.landmarks.size(); ++i) {
    if (keyframe.landmarks[i] == kNoLandmark) continue;
    const Keypoint& seen = keyframe.keypoints[i];
    points.push_back({static_cast<int>(i), keyframe.landmarks[i], {seen.x, seen.y}});
  }
  return points;
}

// Whether a pose that was found without a prediction lies near it: within ten standard deviations,
// for few points leave a few centimetres open.
bool Agrees(const PosePrior& prediction, const Rigid3& world_from_cam) {
  constexpr double kMaxSigmas = 10;
  const PoseParameter pose = ToParameter(world_from_cam);
  const double* blocks[] = {pose.data()};
  Eigen::Matrix<double, 6, 1> residuals;
  PosePriorFactor(prediction).Evaluate(blocks, residuals.data(), nullptr);
  return residuals.norm() < kMaxSigmas;
}

BundleOptions LocalBundleOptions(const LocalMapOptions& local_map) {
  BundleOptions options;
  options.robust_iterations = options.final_iterations = local_map.iterations;
  options.least_scale = local_map.least_scale;
  return options;
}

}  // namespace

Odometry::Odometry(const OdometryOptions& options, const MapCalibration& calibration,
                   const Parts& parts)
    : options_(options),
      rectifier_(parts.rectifier),
      detector_(parts.detector),
      matcher_(parts.matcher),
      recorder_(parts.recorder),
      inertial_(parts.inertial),
      times_(parts.times),
      map_(calibration, options_.local_map, options_.tracking.pixel_sigma, options_.lines),
      tracker_(options_.tracking, map_, matcher_),
      builder_(options_, tracker_, map_),
      line_builder_(options_.lines, map_),
      line_search_(parts.line_detector, rectifier_, options_.lines, times_),
      bundle_worker_(LocalBundleOptions(options_.local_map), parts.times) {}

FrameObservation Odometry::Process(const PreparedFrame& frame) {
  const auto start = std::chrono::steady_clock::now();
  points_.clear();
  features_.reset();
  lined_.reset();
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
  if (inertial_ != nullptr) {
    ScopedStage stage(times_, "inertial");
    inertial_->TryInitialize(records_, map_.map());
  }
  return Observe(frame);
}

FrameObservation Odometry::Observe(const PreparedFrame& frame) const {
  const FrameRecord& record = records_.back();
  FrameObservation seen{frame, record, points_};
  if (features_) seen.features = features_->known();
  if (record.is_keyframe) seen.keyframe = &map_.last();
  if (lined_) seen.lined = &map_.map().keyframes.at(*lined_);
  if (inertial_ != nullptr && record.has_pose()) {
    seen.inertial = inertial_->EstimateAt(record.timestamp_ns);
  }
  return seen;
}

void Odometry::Estimate(const PreparedFrame& frame, FrameRecord& record) {
  const Pinhole& camera = map_.stereo().camera;
  features_.emplace(cv::Size(camera.width, camera.height), [&] { return DetectLeft(frame); });
  const ImagePyramid pyramid = MakePyramid(frame.left);
  const FrameView view{pyramid, *features_};
  if (map_.empty()) return Start(frame, view, record);

  std::optional<PosePrior> inertial;
  if (inertial_ != nullptr) {
    ScopedStage stage(times_, "inertial");
    inertial = inertial_->Predict(frame.timestamp_ns);
  }
  std::optional<TrackedFrame> tracked;
  {
    ScopedStage stage(times_, "track");
    tracked = Find(frame, view, inertial);
  }
  if (tracked) {
    Hit(frame, view, *tracked, record);
  } else {
    Miss(frame, view, record);
  }
}

std::optional<TrackedFrame> Odometry::Find(const PreparedFrame& frame, const FrameView& view,
                                           const std::optional<PosePrior>& inertial) const {
  std::optional<TrackedFrame> tracked;
  if (lost_frames_ == 0) {
    const Rigid3& world_from_reference =
        map_.map().keyframes.at(motion_.reference()).world_from_cam;
    PosePrior prediction = motion_.Predict(frame.timestamp_ns, world_from_reference);
    if (inertial && inertial->SigmaPosition() < prediction.SigmaPosition()) prediction = *inertial;
    tracked = tracker_.Track(view, map_.last(), prediction);
  } else if (inertial) {
    tracked = TrackNear(view, *inertial);
  }
  if (tracked) return tracked;
  tracked = Recover(view);
  if (tracked && inertial && !Agrees(*inertial, tracked->world_from_cam)) return std::nullopt;
  return tracked;
}

// After some time without vision the prediction is all there is, and it may show what an earlier
// keyframe saw.
std::optional<TrackedFrame> Odometry::TrackNear(const FrameView& view,
                                                const PosePrior& inertial) const {
  const RecoveryOptions& recovery = options_.recovery;
  if (static_cast<int>(view.features.detections().keypoints.size()) < recovery.min_inliers) {
    return std::nullopt;
  }
  const std::span<const KeyframeId> window = map_.window();
  int tries = recovery.keyframes;
  for (auto id = window.rbegin(); id != window.rend() && tries > 0; ++id, --tries) {
    auto tracked = tracker_.Track(view, map_.map().keyframes.at(*id), inertial);
    if (!tracked) continue;
    const int found = static_cast<int>(tracked->points.size());
    if (found >= recovery.min_inliers && found >= recovery.min_found_share * tracked->in_sight) {
      return tracked;
    }
  }
  return std::nullopt;
}

VisualPose Odometry::ToVisualPose(const TrackedFrame& tracked) const {
  std::vector<PointConstraint> constraints;
  for (const TrackedPoint& point : tracked.points) {
    constraints.push_back({map_.map().landmarks.at(point.landmark).point_in_world,
                           {point.pixel, -1, options_.tracking.pixel_sigma}});
  }
  VisualPose seen;
  seen.world_from_cam = tracked.world_from_cam;
  seen.information = PoseInformation(map_.stereo(), constraints, tracked.world_from_cam);
  return seen;
}

void Odometry::Miss(const PreparedFrame& frame, const FrameView& view, FrameRecord& record) {
  ++lost_frames_;
  motion_.Reset();
  if (const auto world_from_cam = inertial_ != nullptr ? inertial_->Coast() : std::nullopt) {
    record.state = FrameState::kInertial;
    record.component = component_;
    record.reference = map_.last().id;
    record.reference_from_cam = map_.last().world_from_cam.Inverse() * *world_from_cam;
    record.online_world_from_cam = *world_from_cam;
    const int features = static_cast<int>(view.features.detections().keypoints.size());
    strange_frames_ = features >= options_.recovery.min_stereo_points ? strange_frames_ + 1 : 0;
    if (strange_frames_ > options_.recovery.lost_frames) Continue(frame, view, record);
  } else if (lost_frames_ > options_.recovery.lost_frames) {
    Start(frame, view, record);
  }
}

void Odometry::Hit(const PreparedFrame& frame, const FrameView& view, TrackedFrame& tracked,
                   FrameRecord& record) {
  const bool was_lost = lost_frames_ > 0;
  lost_frames_ = strange_frames_ = 0;
  record.state = FrameState::kTracked;
  record.component = component_;
  record.reference = tracked.keyframe;
  const Rigid3& world_from_reference = map_.map().keyframes.at(record.reference).world_from_cam;
  record.reference_from_cam = world_from_reference.Inverse() * tracked.world_from_cam;
  record.online_world_from_cam = tracked.world_from_cam;
  record.tracked_points = static_cast<int>(tracked.points.size());
  points_ = tracked.points;
  record.used_matcher = tracked.used_matcher;
  motion_.Observe(frame.timestamp_ns, record.reference, record.reference_from_cam,
                  world_from_reference);
  if (inertial_ != nullptr) inertial_->Observe(frame.timestamp_ns, ToVisualPose(tracked));
  if (!was_lost && !NeedsKeyframe(tracked)) return;
  ScopedStage stage(times_, "keyframe");
  std::future<ImagePyramid> right = PrepareRight(frame);
  view.features.detections();  // they need no map: found while the bundle may still run
  // The keyframe must start from the latest map; its own pose moves with its reference.
  if (bundle_due_) TakeBundle();
  tracked.world_from_cam =
      map_.map().keyframes.at(record.reference).world_from_cam * record.reference_from_cam;
  std::erase_if(tracked.points, [&](const TrackedPoint& point) {
    return !map_.map().landmarks.contains(point.landmark);  // an outlier by now
  });
  KeyframeDraft draft = builder_.FromTracked(view, frame.timestamp_ns, tracked);
  MatchRight(view, std::move(right), draft);
  if (was_lost || IsWorthwhile(draft.keyframe, tracked)) {
    InsertKeyframe(frame, view, std::move(draft), record);
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

// Most frames are no keyframes and need no lines; the maps that this pass leaves give them later.
Detections Odometry::DetectLeft(const PreparedFrame& frame) const {
  ScopedStage stage(times_, "detect left");
  DetectionRequest request(options_.max_keypoints);
  request.keep_maps = UsesLines();
  return detector_.Detect(frame.left, rectifier_.left_mask(), request);
}

std::future<ImagePyramid> Odometry::PrepareRight(const PreparedFrame& frame) const {
  return std::async(std::launch::async, [this, &frame] {
    ScopedStage stage(times_, "rectify right");
    return MakePyramid(rectifier_.RectifyRight(frame.right_raw));
  });
}

void Odometry::MatchRight(const FrameView& view, std::future<ImagePyramid> right,
                          KeyframeDraft& draft) const {
  ImagePyramid right_image = right.get();
  ScopedStage stage(times_, "match stereo");
  builder_.MatchRight(view, std::move(right_image), draft);
}

std::optional<KeyframeDraft> Odometry::DraftAnew(const PreparedFrame& frame, const FrameView& view,
                                                 int component, const Rigid3& world_from_cam) {
  std::future<ImagePyramid> right = PrepareRight(frame);
  KeyframeDraft draft =
      builder_.FromDetections(view, frame.timestamp_ns, component, world_from_cam);
  MatchRight(view, std::move(right), draft);
  const std::vector<float>& right_x = draft.keyframe.right_x;
  const auto matched =
      std::count_if(right_x.begin(), right_x.end(), [](float x) { return x >= 0; });
  // Where there is too little depth, the next frame may have more.
  if (matched < options_.recovery.min_stereo_points) return std::nullopt;
  return draft;
}

void Odometry::Start(const PreparedFrame& frame, const FrameView& view, FrameRecord& record) {
  if (bundle_due_) TakeBundle();
  // The body of a component's first keyframe is the origin of its world.
  auto draft = DraftAnew(frame, view, component_ + 1, map_.map().calibration.body_from_left);
  if (!draft) return;
  ++component_;
  if (inertial_ != nullptr) inertial_->StartComponent(component_, frame.timestamp_ns);
  record.state = FrameState::kInitialized;
  Begin(frame, view, std::move(*draft), record);
}

void Odometry::Continue(const PreparedFrame& frame, const FrameView& view, FrameRecord& record) {
  if (bundle_due_) TakeBundle();
  auto draft = DraftAnew(frame, view, component_, inertial_->world_from_cam());
  if (!draft) return;
  inertial_->Observe(frame.timestamp_ns, {inertial_->world_from_cam()});
  Begin(frame, view, std::move(*draft), record);
}

void Odometry::Begin(const PreparedFrame& frame, const FrameView& view, KeyframeDraft draft,
                     FrameRecord& record) {
  const Keyframe& keyframe = draft.keyframe;
  lost_frames_ = strange_frames_ = 0;
  record.component = component_;
  record.online_world_from_cam = keyframe.world_from_cam;
  motion_ = {};
  motion_.Observe(frame.timestamp_ns, keyframe.id, {}, keyframe.world_from_cam);
  InsertKeyframe(frame, view, std::move(draft), record);
  points_ = OwnPoints(map_.last());
  record.tracked_points = static_cast<int>(points_.size());
}

void Odometry::InsertKeyframe(const PreparedFrame& frame, const FrameView& view,
                              KeyframeDraft draft, FrameRecord& record) {
  TakeLines();
  Keyframe& keyframe = draft.keyframe;
  // Where it knows no landmark its pose is not exact enough for triangulation.
  const bool is_placed = CountLandmarks(keyframe) > 0;
  std::vector<LandmarkId> added = builder_.AddStereoLandmarks(keyframe);
  std::vector<LandmarkId> from_motion;
  if (is_placed) from_motion = builder_.AddMotionLandmarks(view, keyframe);
  added.insert(added.end(), from_motion.begin(), from_motion.end());
  for (int index : draft.redefining) {
    map_.SetSource(keyframe.landmarks[index], {keyframe.id, index});
  }
  record.is_keyframe = true;
  record.reference = keyframe.id;
  record.reference_from_cam = {};
  motion_.MoveTo(keyframe.id);
  if (inertial_ != nullptr) inertial_->FillKeyframe(keyframe);
  if (recorder_ != nullptr) Record(keyframe, added, !from_motion.empty());
  map_.AddKeyframe(std::move(keyframe), view.image);
  if (UsesLines()) {
    line_search_.Begin(
        {map_.last().id, view.image, std::move(draft.right_image), view.features.detections()});
  }
  BundleJob job = map_.MakeBundleJob();
  if (inertial_ != nullptr) inertial_->AddTo(job, map_.map());
  bundle_worker_.Submit(std::move(job));
  bundle_due_ = frame.index + options_.local_map.lag_frames;
}

void Odometry::Record(const Keyframe& keyframe, std::span<const LandmarkId> added,
                      bool last_sees_more) {
  const Map& map = map_.map();
  std::vector<Landmark> landmarks;
  for (LandmarkId id : added) landmarks.push_back(map.landmarks.at(id));
  recorder_->AddKeyframe(keyframe, std::move(landmarks));
  if (!last_sees_more) return;
  MapWriter::Update update;
  update.keyframe_landmarks = {{map_.last().id, map_.last().landmarks}};
  recorder_->Apply(std::move(update));
}

// The map must not be under adjustment.
void Odometry::TakeLines() {
  std::optional<KeyframeLines> found = line_search_.Take();
  if (!found) return;
  ScopedStage stage(times_, "match lines");
  const LineChanges changes = line_builder_.AddLines(std::move(*found));
  lined_ = changes.keyframe;
  if (recorder_ == nullptr) return;
  const Map& map = map_.map();
  std::vector<LineLandmark> landmarks;
  for (LandmarkId id : changes.added) landmarks.push_back(map.line_landmarks.at(id));
  recorder_->AddLines(map.keyframes.at(changes.keyframe), std::move(landmarks));
  if (changes.observed.empty()) return;
  // A line's first keyframe may be an earlier one, which then sees it too.
  MapWriter::Update update;
  for (KeyframeId id : changes.observed) {
    update.keyframe_line_landmarks.emplace_back(id, map.keyframes.at(id).line_landmarks);
  }
  recorder_->Apply(std::move(update));
}

void Odometry::TakeBundle() {
  ScopedStage stage(times_, "wait for bundle");
  bundle_due_.reset();
  const Rigid3& reference = map_.map().keyframes.at(motion_.reference()).world_from_cam;
  const Rigid3 before = reference;
  MapWriter::Update update = map_.Apply(bundle_worker_.Take());
  motion_.Rebase(reference);
  if (inertial_ != nullptr) inertial_->Rebase(reference * before.Inverse(), map_.last());
  if (recorder_ != nullptr) recorder_->Apply(std::move(update));
}

void Odometry::Finish() {
  if (bundle_due_) TakeBundle();
  TakeLines();
  MapWriter::Update settled;
  map_.lines().Settle(settled);
  if (recorder_ != nullptr && !settled.removed_line_landmarks.empty()) {
    recorder_->Apply(std::move(settled));
  }
  if (inertial_ == nullptr) return;
  inertial_->SmoothCoastedFrames(records_, map_.map());
  auto corrected = inertial_->CorrectReadings(map_.map());
  if (recorder_ != nullptr && !corrected.empty()) {
    MapWriter::Update update;
    update.imu_readings = std::move(corrected);
    recorder_->Apply(std::move(update));
  }
  for (const InertialStart& start : inertial_->summary().starts) {
    MapWriter::Update update = TurnComponent(UprightFromWorld(start.gravity_in_world),
                                             start.component, map_.map(), records_);
    if (recorder_ != nullptr) recorder_->Apply(std::move(update));
  }
}

}  // namespace airslam
