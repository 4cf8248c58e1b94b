// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/inertial_odometry.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "airslam/common/log.h"
#include "airslam/geometry/so3.h"
#include "airslam/sensor/imu_noise.h"

namespace airslam {
namespace {

constexpr double kDegrees = 180 / std::numbers::pi;

// A start is looked for in this many of the latest frames at the most, evenly spread over this many
// seconds at the most: more tell little more, and cost.
constexpr int kMaxStartFrames = 40;
constexpr double kMaxStartSpan = 20;
// rad: poses drift together, so that an initialisation's own figure is too good in the end.
constexpr double kLeastGravitySigma = 5e-4;
// After so long a start that is still refused goes into the log (seconds).
constexpr double kPatience = 5;
// Seconds: readings over more than this do not tie two keyframes together.
constexpr double kMaxLink = 10;
// Noise that poses found by vision have on top of their points' (rad, m); the same as in the
// initialisation.
constexpr double kPoseRotation = 5e-4, kPosePosition = 3e-3;
// m/s: a velocity just found by the initialisation, and one that is not known.
constexpr double kStartVelocity = 0.05, kUnknownVelocity = 2;
// m/s: a keyframe whose velocity is known worse has none.
constexpr double kUsefulVelocity = 0.3;
// Time offsets are corrected this many times at the most.
constexpr int kMaxOffsetCorrections = 3;

double Seconds(std::int64_t begin_ns, std::int64_t end_ns) {
  return 1e-9 * static_cast<double>(end_ns - begin_ns);
}

ImuBufferOptions BufferOptions(const InertialOptions& options, double time_offset) {
  return {time_offset, options.max_gap, options.max_angular_velocity, options.max_acceleration};
}

// Variances of rotation, velocity, position, as the frame that vision has just found has them.
Matrix15d FrameCovariance(double sigma_velocity, const Matrix6d& biases) {
  Matrix15d covariance = Matrix15d::Zero();
  covariance.diagonal().segment<3>(0).setConstant(kPoseRotation * kPoseRotation);
  covariance.diagonal().segment<3>(3).setConstant(sigma_velocity * sigma_velocity);
  covariance.diagonal().segment<3>(6).setConstant(kPosePosition * kPosePosition);
  covariance.bottomRightCorner<6, 6>() = biases;
  return covariance;
}

// Of an initialisation's biases. What gravity errs by counts as an error of the accelerometer's.
Matrix6d BiasCovariance(const InertialInitialization& result) {
  const double gyroscope = result.gyroscope_bias_sigma;
  const double accelerometer = std::hypot(result.accelerometer_bias_sigma,
                                          result.gravity_sigma * result.gravity_in_world.norm());
  Matrix6d covariance = Matrix6d::Zero();
  covariance.diagonal().head<3>().setConstant(gyroscope * gyroscope);
  covariance.diagonal().tail<3>().setConstant(accelerometer * accelerometer);
  return covariance;
}

InertialState StateOf(const Keyframe& keyframe, const Rigid3& cam_from_body) {
  return {keyframe.world_from_cam * cam_from_body,
          keyframe.velocity_in_world,
          {keyframe.gyroscope_bias, keyframe.accelerometer_bias}};
}

void SetBias(Keyframe& keyframe, const ImuBias& bias) {
  keyframe.gyroscope_bias = bias.gyroscope;
  keyframe.accelerometer_bias = bias.accelerometer;
}

}  // namespace

InertialOdometry::InertialOdometry(const InertialOptions& options,
                                   const std::vector<ImuSample>& samples, const ImuNoise& noise,
                                   double time_offset, const Rigid3& body_from_cam, ImuSource more)
    : options_(options),
      noise_(noise),
      body_from_cam_(body_from_cam),
      imu_(samples, BufferOptions(options, time_offset)),
      more_(std::move(more)) {
  summary_.readings = static_cast<int>(imu_.samples().size());
  summary_.dropped = imu_.dropped();
  summary_.calibrated_time_offset = time_offset;
  summary_.state = ToString(InertialRefusal::kTooShort);
  summary_.reason = "no component was long enough";
  if (imu_.dropped() > 0) {
    LogWarn("{} IMU readings repeat a time or go back: left out", imu_.dropped());
  }
}

void InertialOdometry::Fetch(std::int64_t timestamp_ns, double margin) {
  if (!more_) return;
  const double ahead = imu_.options().time_offset;
  imu_.Append(more_(timestamp_ns + std::llround(1e9 * ahead) + std::llround(1e9 * margin)));
  summary_.readings = static_cast<int>(imu_.samples().size());
}

void InertialOdometry::StartComponent(int component, std::int64_t timestamp_ns) {
  component_ = component;
  component_begin_ns_ = frames_begin_ns_ = last_try_ns_ = last_seen_ns_ = timestamp_ns;
  said_why_ = false;
  start_.reset();
  filter_.reset();
  predicted_.reset();
  biases_.clear();
  links_.clear();
  last_keyframe_ns_.reset();
}

// Nothing where readings are missing or saturated.
std::optional<ImuPreintegration> InertialOdometry::Readings(std::int64_t begin_ns,
                                                            std::int64_t end_ns,
                                                            const ImuBias& bias) const {
  ImuInterval interval = imu_.Between(begin_ns, end_ns);
  if (!interval.complete() || interval.saturated > 0) return std::nullopt;
  // Noise is judged over a second at least.
  constexpr std::int64_t kSecond = 1'000'000'000;
  const ImuNoise noise =
      WithMeasuredNoise(noise_, imu_.Between(std::min(begin_ns, end_ns - kSecond), end_ns).samples);
  return ImuPreintegration(std::move(interval.samples), noise, bias);
}

void InertialOdometry::NoteGap(std::int64_t begin_ns, std::int64_t end_ns) {
  if (!summary_.gaps.empty() && summary_.gaps.back().end_ns >= begin_ns) {
    summary_.gaps.back().end_ns = end_ns;
    return;
  }
  summary_.gaps.push_back({begin_ns, end_ns});
  const ImuInterval interval = imu_.Between(begin_ns, end_ns);
  if (interval.complete()) {
    LogWarn("at {} ns IMU readings reach the end of their scale: vision alone there", end_ns);
  } else {
    LogWarn("IMU gap at {} ns: vision alone there", end_ns);
  }
}

std::optional<InertialEstimate> InertialOdometry::EstimateAt(std::int64_t timestamp_ns) const {
  if (!filter_ || filter_->timestamp_ns() != timestamp_ns) return std::nullopt;
  const InertialState& state = filter_->state();
  return InertialEstimate{state.velocity_in_world, state.bias, start_->gravity_in_world};
}

std::optional<PosePrior> InertialOdometry::Predict(std::int64_t timestamp_ns) {
  Fetch(timestamp_ns, 0);
  predicted_.reset();
  if (!filter_ || Seconds(filter_->timestamp_ns(), timestamp_ns) > kMaxLink) return std::nullopt;
  const auto readings = Readings(filter_->timestamp_ns(), timestamp_ns, filter_->state().bias);
  if (!readings) {
    NoteGap(filter_->timestamp_ns(), timestamp_ns);
    return std::nullopt;
  }
  predicted_ = filter_;
  predicted_->Propagate(*readings, start_->gravity_in_world);
  return predicted_->Prior();
}

void InertialOdometry::Observe(std::int64_t timestamp_ns, const VisualPose& seen) {
  last_seen_ns_ = timestamp_ns;
  if (!start_) return;
  if (predicted_) {
    filter_ = std::exchange(predicted_, std::nullopt);
    VisualPose pose = seen;
    pose.floor_rotation = kPoseRotation;
    pose.floor_position = kPosePosition;
    filter_->Correct(pose);
    return;
  }
  // After a gap the biases are what they were; the velocity is not known.
  const Matrix6d biases = filter_->covariance().bottomRightCorner<6, 6>();
  filter_ = InertialFilter(timestamp_ns,
                           {seen.world_from_cam * body_from_cam_.Inverse(), Eigen::Vector3d::Zero(),
                            filter_->state().bias},
                           FrameCovariance(kUnknownVelocity, biases), body_from_cam_);
}

std::optional<Rigid3> InertialOdometry::Coast() {
  if (!predicted_) return std::nullopt;
  if (Seconds(last_seen_ns_, predicted_->timestamp_ns()) > options_.max_blackout ||
      predicted_->SigmaPosition() > options_.max_position_sigma) {
    return std::nullopt;
  }
  filter_ = std::exchange(predicted_, std::nullopt);
  return filter_->world_from_cam();
}

void InertialOdometry::Rebase(const Rigid3& change, const Keyframe& latest) {
  if (!filter_) return;
  InertialState state = filter_->state();
  state.world_from_body = change * state.world_from_body;
  state.velocity_in_world = change.rotation * state.velocity_in_world;
  const std::int64_t now = filter_->timestamp_ns();
  if (latest.has_inertial_state && latest.timestamp_ns <= now) {
    const InertialState start = StateOf(latest, body_from_cam_.Inverse());
    InertialState end = start;
    if (latest.timestamp_ns < now) {
      const auto readings = Readings(latest.timestamp_ns, now, start.bias);
      if (!readings || readings->duration() > kMaxLink) return filter_->Replace(state);
      end = airslam::Predict(start, *readings, start_->gravity_in_world);
    }
    // A frame that vision has found stays where it hangs on its keyframe.
    if (last_seen_ns_ < now) state.world_from_body = end.world_from_body;
    state.velocity_in_world = end.velocity_in_world;
    state.bias = end.bias;
  }
  filter_->Replace(state);
}

void InertialOdometry::FillReadings(std::int64_t begin_ns, Keyframe& keyframe) const {
  if (Seconds(begin_ns, keyframe.timestamp_ns) > kMaxLink) return;
  const auto readings = Readings(begin_ns, keyframe.timestamp_ns, {});
  if (!readings) return;
  keyframe.imu_samples = readings->samples();
  keyframe.imu_noise = readings->noise();
}

std::vector<MapWriter::Update::ImuReadings> InertialOdometry::CorrectReadings(Map& map) {
  std::vector<MapWriter::Update::ImuReadings> corrected;
  if (!readings_outdated_) return corrected;
  std::map<int, std::int64_t> last;  // of each component
  for (auto& [id, keyframe] : map.keyframes) {
    const auto before = last.find(keyframe.component);
    if (before != last.end()) {
      FillReadings(before->second, keyframe);
      corrected.push_back({id, keyframe.imu_samples, keyframe.imu_noise});
    }
    last[keyframe.component] = keyframe.timestamp_ns;
  }
  readings_outdated_ = false;
  return corrected;
}

void InertialOdometry::FillKeyframe(Keyframe& keyframe) {
  if (last_keyframe_ns_) FillReadings(*last_keyframe_ns_, keyframe);
  last_keyframe_ns_ = keyframe.timestamp_ns;
  if (!filter_ || filter_->timestamp_ns() != keyframe.timestamp_ns) return;
  const Matrix15d& covariance = filter_->covariance();
  if (covariance.diagonal().segment<3>(3).maxCoeff() > kUsefulVelocity * kUsefulVelocity) return;
  keyframe.has_inertial_state = true;
  keyframe.velocity_in_world = filter_->state().velocity_in_world;
  SetBias(keyframe, filter_->state().bias);
  biases_[keyframe.id] = {filter_->state().bias, covariance.bottomRightCorner<6, 6>()};
}

std::shared_ptr<const ImuPreintegration> InertialOdometry::Link(const Keyframe& from,
                                                                const Keyframe& to) {
  if (Seconds(from.timestamp_ns, to.timestamp_ns) > kMaxLink) return nullptr;
  const ImuBias bias{from.gyroscope_bias, from.accelerometer_bias};
  std::shared_ptr<const ImuPreintegration>& link = links_[to.id];
  const bool fits = link && link->samples().front().timestamp_ns == from.timestamp_ns;
  if (fits && !link->IsFar(bias)) return link;
  const auto readings = Readings(from.timestamp_ns, to.timestamp_ns, bias);
  link = readings ? std::make_shared<const ImuPreintegration>(*readings) : nullptr;
  return link;
}

void InertialOdometry::AddTo(BundleJob& job, const Map& map) {
  if (!start_) return;
  InertialTerms& terms = job.problem.inertial;
  terms.gravity_in_world = start_->gravity_in_world;
  terms.gravity_sigma = std::max(start_->gravity_sigma, kLeastGravitySigma);
  terms.body_from_cam = body_from_cam_;
  const std::vector<bool>& fixed = job.problem.pose_fixed;
  const Keyframe* previous = nullptr;
  for (std::size_t i = 0; i < job.keyframes.size(); ++i) {
    // Of the keyframes that hold the window only the latest is tied to it.
    if (fixed[i] && (i + 1 == fixed.size() || fixed[i + 1])) continue;
    const Keyframe& keyframe = map.keyframes.at(job.keyframes[i]);
    if (!keyframe.has_inertial_state) {
      previous = nullptr;
      continue;
    }
    const int state = static_cast<int>(terms.states.size());
    terms.states.push_back({static_cast<int>(i),
                            keyframe.velocity_in_world,
                            {keyframe.gyroscope_bias, keyframe.accelerometer_bias}});
    if (previous != nullptr) {
      if (auto link = Link(*previous, keyframe)) {
        const bool begins = terms.links.empty() || terms.links.back().to != state - 1;
        if (begins) {
          const KnownBias& known = biases_.at(previous->id);
          terms.priors.push_back({state - 1, known.mean, known.covariance});
        }
        terms.links.push_back({state - 1, state, std::move(link)});
      }
    }
    previous = &keyframe;
  }
}

bool InertialOdometry::IsDue(std::int64_t now) const {
  const double waited = Seconds(last_try_ns_, now), span = Seconds(frames_begin_ns_, now);
  if (!start_) return waited >= (span < kPatience ? 0.5 : span < 2 * kPatience ? 1.0 : 2.0);
  if (start_->at_rest) return waited >= 1;
  if (start_->span >= 0.95 * kMaxStartSpan) return false;
  return waited >= 1 && span >= 1.5 * start_->span;
}

std::vector<InertialFrame> InertialOdometry::StartFrames(std::span<const FrameRecord> records,
                                                         const Map& map) const {
  const std::int64_t now = records.back().timestamp_ns;
  std::vector<const FrameRecord*> seen;
  for (const FrameRecord& record : records) {
    if (record.component != component_ || record.state == FrameState::kInertial) continue;
    if (record.timestamp_ns < frames_begin_ns_) continue;
    if (Seconds(record.timestamp_ns, now) <= kMaxStartSpan) seen.push_back(&record);
  }
  const std::size_t count = std::min<std::size_t>(seen.size(), kMaxStartFrames);
  std::vector<InertialFrame> frames;
  for (std::size_t i = 0; i < count; ++i) {  // the first and the last among them
    const std::size_t k = count > 1 ? i * (seen.size() - 1) / (count - 1) : 0;
    const Keyframe& reference = map.keyframes.at(seen[k]->reference);
    frames.push_back(
        {seen[k]->timestamp_ns, reference.world_from_cam * seen[k]->reference_from_cam});
  }
  return frames;
}

bool InertialOdometry::CorrectTimeOffset(const InertialInitialization& result) {
  if (result.refusal != InertialRefusal::kTimeOffset) return false;
  if (offset_corrections_ >= kMaxOffsetCorrections) return false;
  ++offset_corrections_;
  imu_ = imu_.WithTimeOffset(imu_.options().time_offset + result.time_offset);
  links_.clear();
  readings_outdated_ = true;
  LogWarn("{}: corrected", result.reason);
  return true;
}

void InertialOdometry::Refused(const InertialInitialization& result, std::int64_t now) {
  if (start_) return;  // what there is stays
  if (summary_.starts.empty()) {
    summary_.state = ToString(result.refusal);
    summary_.reason = result.reason;
  }
  if (!said_why_ && Seconds(component_begin_ns_, now) > kPatience) {
    said_why_ = true;
    LogWarn("goes on as stereo, the IMU is not initialised yet: {}", result.reason);
  }
  // Frames from before missing readings are of no use.
  if (result.refusal == InertialRefusal::kImuGap || result.refusal == InertialRefusal::kSaturated) {
    frames_begin_ns_ = now;
  }
}

void InertialOdometry::TryInitialize(std::span<const FrameRecord> records, Map& map) {
  if (records.empty() || component_ < 0) return;
  const FrameRecord& last = records.back();
  const std::int64_t now = last.timestamp_ns;
  if (last.component != component_ || last_seen_ns_ != now || !IsDue(now)) return;
  last_try_ns_ = now;
  const std::vector<InertialFrame> frames = StartFrames(records, map);
  if (frames.empty()) return;
  const InertialInitializationOptions options;
  InertialInitialization result;
  do {
    Fetch(now, options.time_offset_search + options.time_offset_step);
    const ImuNoise noise = WithMeasuredNoise(
        noise_, imu_.Between(frames.front().timestamp_ns, frames.back().timestamp_ns).samples);
    result = InitializeInertial(options, frames, imu_, noise, body_from_cam_);
  } while (CorrectTimeOffset(result));
  if (!result.ok()) return Refused(result, now);
  const bool better = !start_ || result.gravity_sigma < start_->gravity_sigma ||
                      (start_->at_rest && result.at_rest);
  if (better) Accept(result, frames, map);
}

void InertialOdometry::Accept(const InertialInitialization& result,
                              const std::vector<InertialFrame>& frames, Map& map) {
  const InertialFrame& newest = frames.back();
  if (!start_) {
    start_ = InertialStart{};
    start_->component = component_;
    start_->timestamp_ns = newest.timestamp_ns;
    start_->seconds = Seconds(component_begin_ns_, newest.timestamp_ns);
    summary_.starts.push_back(*start_);
    LogInfo("IMU initialised {} after {:.1f} s: gravity within {:.2f} degrees",
            result.at_rest ? "at rest" : "in motion", start_->seconds,
            kDegrees * result.gravity_sigma);
  } else {
    ++start_->refinements;
  }
  start_->at_rest = result.at_rest;
  start_->span = Seconds(frames.front().timestamp_ns, newest.timestamp_ns);
  start_->gravity_in_world = result.gravity_in_world;
  start_->bias = result.bias;
  start_->gravity_sigma = result.gravity_sigma;
  start_->gyroscope_bias_sigma = result.gyroscope_bias_sigma;
  start_->accelerometer_bias_sigma = result.accelerometer_bias_sigma;
  summary_.starts.back() = *start_;

  const Matrix6d biases = BiasCovariance(result);
  filter_ = InertialFilter(newest.timestamp_ns,
                           {newest.world_from_cam * body_from_cam_.Inverse(),
                            result.velocities_in_world.back(), result.bias},
                           FrameCovariance(kStartVelocity, biases), body_from_cam_);
  FillKeyframes(result, newest, map);
  biases_.clear();
  for (const auto& [id, keyframe] : map.keyframes) {
    if (keyframe.component == component_) biases_[id] = {result.bias, biases};
  }
}

// Velocities from the poses of neighbours in time and the readings between them.
void InertialOdometry::FillKeyframes(const InertialInitialization& result,
                                     const InertialFrame& newest, Map& map) {
  const Rigid3 cam_from_body = body_from_cam_.Inverse();
  Rigid3 next_body = newest.world_from_cam * cam_from_body;
  std::int64_t next_ns = newest.timestamp_ns;
  for (auto it = map.keyframes.rbegin(); it != map.keyframes.rend(); ++it) {
    Keyframe& keyframe = it->second;
    if (keyframe.component != component_) break;
    const Rigid3 body = keyframe.world_from_cam * cam_from_body;
    if (!keyframe.has_inertial_state && keyframe.timestamp_ns == newest.timestamp_ns) {
      keyframe.has_inertial_state = true;
      keyframe.velocity_in_world = result.velocities_in_world.back();
    } else if (!keyframe.has_inertial_state) {
      if (const auto readings = Readings(keyframe.timestamp_ns, next_ns, result.bias)) {
        const double t = readings->duration();
        keyframe.has_inertial_state = true;
        keyframe.velocity_in_world = (next_body.translation - body.translation -
                                      body.rotation * readings->delta().position) /
                                         t -
                                     0.5 * t * result.gravity_in_world;
      }
    }
    if (keyframe.has_inertial_state) SetBias(keyframe, result.bias);
    next_body = body;
    next_ns = keyframe.timestamp_ns;
  }
}

void InertialOdometry::SmoothCoastedFrames(std::span<FrameRecord> records, const Map& map) const {
  const Rigid3 cam_from_body = body_from_cam_.Inverse();
  for (FrameRecord& record : records) {
    if (record.state != FrameState::kInertial || record.is_keyframe) continue;
    const auto start =
        std::find_if(summary_.starts.begin(), summary_.starts.end(),
                     [&](const InertialStart& s) { return s.component == record.component; });
    const auto before = map.keyframes.find(record.reference);
    const auto after = std::next(before);
    if (start == summary_.starts.end() || after == map.keyframes.end()) continue;
    const Keyframe &from = before->second, &to = after->second;
    if (!from.has_inertial_state || to.component != from.component) continue;
    const InertialState begin = StateOf(from, cam_from_body);
    const auto half = Readings(from.timestamp_ns, record.timestamp_ns, begin.bias);
    const auto whole = Readings(from.timestamp_ns, to.timestamp_ns, begin.bias);
    if (!half || !whole) continue;
    const Rigid3 body = airslam::Predict(begin, *half, start->gravity_in_world).world_from_body;
    const Rigid3 end = airslam::Predict(begin, *whole, start->gravity_in_world).world_from_body;
    // What the integration misses the later keyframe by is spread over the time.
    const Rigid3 target = to.world_from_cam * cam_from_body;
    const double part = half->duration() / whole->duration();
    const Rigid3 smooth(
        body.rotation * ExpSO3(part * LogSO3(end.rotation.conjugate() * target.rotation)),
        body.translation + part * (target.translation - end.translation));
    record.reference_from_cam = from.world_from_cam.Inverse() * smooth * body_from_cam_;
  }
}

InertialSummary InertialOdometry::summary() const {
  InertialSummary summary = summary_;
  if (summary.readings == 0) {
    summary.state = "no readings";
    summary.reason = "the sequence has no IMU readings";
  }
  summary.time_offset = imu_.options().time_offset;
  if (!summary.starts.empty()) {
    summary.state = "used";
    summary.reason.clear();
  }
  if (filter_) summary.final_bias = filter_->state().bias;
  return summary;
}

}  // namespace airslam
