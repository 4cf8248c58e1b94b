// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/dataset/live_sequence.h"

#include <utility>

#include "airslam/common/error.h"

namespace airslam {
namespace {

// Frames that may wait to be read before AddFrame() waits.
constexpr std::size_t kReady = 2;
// And while the pipeline waits for readings of the IMU: some seconds of frames.
constexpr std::size_t kReadyWithoutImu = 100;

}  // namespace

LiveSequence::LiveSequence(const StereoRig& rig, bool expects_imu)
    : rig_(rig), expects_imu_(expects_imu && rig.imu) {}

void LiveSequence::AddImu(const ImuSample& sample) {
  if (!sample.angular_velocity.allFinite() || !sample.acceleration.allFinite()) {
    Fail("the IMU reading at {} ns is not finite", sample.timestamp_ns);
  }
  const std::lock_guard lock(mutex_);
  if (abandoned_ || imu_ended_) Fail("an IMU reading at {} ns after the end", sample.timestamp_ns);
  if (last_imu_ns_ && sample.timestamp_ns <= *last_imu_ns_) {
    Fail("the IMU reading at {} ns is not after the last one, at {} ns", sample.timestamp_ns,
         *last_imu_ns_);
  }
  last_imu_ns_ = sample.timestamp_ns;
  if (expects_imu_) samples_.push_back(sample);
  changed_.notify_all();
}

void LiveSequence::CheckImage(const cv::Mat& image, const RigCamera& camera,
                              const char* side) const {
  const Pinhole& pinhole = camera.camera.pinhole;
  if (image.type() != CV_8UC1) Fail("the {} image is not grey of 8 bits a pixel", side);
  if (image.cols != pinhole.width || image.rows != pinhole.height) {
    Fail("the {} image has {}x{} pixels, but the calibration says {}x{}", side, image.cols,
         image.rows, pinhole.width, pinhole.height);
  }
}

void LiveSequence::AddFrame(const StereoPair& pair) {
  CheckImage(pair.left, rig_.left, "left");
  CheckImage(pair.right, rig_.right, "right");
  StereoPair own{pair.timestamp_ns, pair.left.clone(), pair.right.clone()};
  std::unique_lock lock(mutex_);
  if (!times_.empty() && pair.timestamp_ns <= times_.back()) {
    Fail("the frame at {} ns is not after the last one, at {} ns", pair.timestamp_ns,
         times_.back());
  }
  changed_.wait(lock, [this] { return abandoned_ || waits_for_imu_ || waiting_.size() < kReady; });
  if (abandoned_ || ended_) Fail("a frame at {} ns after the end", pair.timestamp_ns);
  if (waiting_.size() >= kReadyWithoutImu) {
    Fail(
        "{} frames wait for readings of the IMU, whose last one is {}: add them before the frames "
        "that need them, or end the IMU",
        waiting_.size(), last_imu_ns_ ? fmt::format("at {} ns", *last_imu_ns_) : "still to come");
  }
  times_.push_back(own.timestamp_ns);
  waiting_.push_back(std::move(own));
  changed_.notify_all();
}

void LiveSequence::EndImu() {
  const std::lock_guard lock(mutex_);
  imu_ended_ = true;
  changed_.notify_all();
}

void LiveSequence::End() {
  const std::lock_guard lock(mutex_);
  imu_ended_ = ended_ = true;
  changed_.notify_all();
}

int LiveSequence::size() const {
  const std::lock_guard lock(mutex_);
  return static_cast<int>(times_.size());
}

std::int64_t LiveSequence::timestamp_ns(int index) const {
  const std::lock_guard lock(mutex_);
  return times_.at(index);
}

bool LiveSequence::Has(int index) const {
  std::unique_lock lock(mutex_);
  const auto count = static_cast<std::size_t>(index) + 1;
  changed_.wait(lock, [&] { return abandoned_ || ended_ || times_.size() >= count; });
  return !abandoned_ && times_.size() >= count;
}

StereoPair LiveSequence::Read(int index) const {
  const std::lock_guard lock(mutex_);
  if (index != read_ || waiting_.empty()) Fail("frame {} of a live sequence is gone", index);
  StereoPair pair = std::move(waiting_.front());
  waiting_.pop_front();
  ++read_;
  changed_.notify_all();
  return pair;
}

void LiveSequence::Abandon() const {
  const std::lock_guard lock(mutex_);
  abandoned_ = true;
  changed_.notify_all();
}

bool LiveSequence::abandoned() const {
  const std::lock_guard lock(mutex_);
  return abandoned_;
}

std::vector<ImuSample> LiveSequence::MoreImu(std::int64_t until_ns) const {
  std::unique_lock lock(mutex_);
  const auto is_there = [&] {
    return abandoned_ || imu_ended_ || (last_imu_ns_ && *last_imu_ns_ >= until_ns);
  };
  waits_for_imu_ = !is_there();
  changed_.notify_all();
  changed_.wait(lock, is_there);
  waits_for_imu_ = false;
  return std::exchange(samples_, {});
}

}  // namespace airslam
