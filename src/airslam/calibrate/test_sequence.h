// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>

#include <functional>
#include <vector>

#include "airslam/testing/synthetic_sequence.h"

namespace airslam {

// The images of a synthetic sequence, rendered once for all tests of a program: 16 pairs at 10 Hz,
// and right images that were taken 20 ms late.
class RenderedFrames {
 public:
  static constexpr int kFrames = 16;
  // In frames of a sequence at 100 Hz. The IMU begins before the images and ends after them.
  static constexpr int kStep = 10, kMargin = 60;

  static const RenderedFrames& Get() {
    static const RenderedFrames frames;
    return frames;
  }
  const SyntheticSequence& source() const { return source_; }
  const StereoPair& pair(int index) const { return pairs_[static_cast<std::size_t>(index)]; }
  const cv::Mat& late_right(int index) const { return late_[static_cast<std::size_t>(index)]; }

 private:
  RenderedFrames() : source_(Options()) {
    for (int i = 0; i < kFrames; ++i) {
      pairs_.push_back(source_.Read(kMargin + kStep * i));
      late_.push_back(source_.Read(kMargin + kStep * i + 2).right);
    }
  }
  static SyntheticSequenceOptions Options() {
    SyntheticSequenceOptions options;
    options.rig = EurocLikeRig(480, 312);
    options.frames = kStep * kFrames + 2 * kMargin;
    options.rate_hz = 100;
    return options;
  }

  SyntheticSequence source_;
  std::vector<StereoPair> pairs_;
  std::vector<cv::Mat> late_;
};

// These frames with a rig, images or readings that a test has spoilt.
class SpoiltFrames : public Sequence {
 public:
  SpoiltFrames() : rig_(frames_.source().rig()), imu_(frames_.source().imu()) { rig_.rate_hz = 10; }
  StereoRig& spoil_rig() { return rig_; }
  std::vector<ImuSample>& spoil_imu() { return imu_; }
  std::function<StereoPair(int)> images = [this](int i) { return frames_.pair(i); };

  const RenderedFrames& frames() const { return frames_; }
  std::string name() const override { return "spoilt"; }
  const StereoRig& rig() const override { return rig_; }
  int size() const override { return RenderedFrames::kFrames - 1; }
  std::int64_t timestamp_ns(int index) const override { return frames_.pair(index).timestamp_ns; }
  const std::vector<ImuSample>& imu() const override { return imu_; }
  const std::vector<std::string>& warnings() const override { return warnings_; }
  StereoPair Read(int index) const override { return images(index); }

 private:
  const RenderedFrames& frames_ = RenderedFrames::Get();
  StereoRig rig_;
  std::vector<ImuSample> imu_;
  std::vector<std::string> warnings_;
};

}  // namespace airslam
