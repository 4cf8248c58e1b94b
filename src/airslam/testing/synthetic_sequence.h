// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "airslam/dataset/sequence.h"
#include "airslam/dataset/trajectory.h"
#include "airslam/testing/image_renderer.h"
#include "airslam/testing/synthetic_motion.h"
#include "airslam/testing/synthetic_rig.h"

namespace airslam {

struct SyntheticSequenceOptions {
  SyntheticWorldOptions world;
  StereoRig rig = EurocLikeRig(320, 208);
  // Mounted by the sequence: its heading_from_body and start time need not be set.
  SyntheticTrajectory trajectory = SyntheticTrajectory::Loop();
  std::int64_t start_ns = 1'700'000'000'000'000'000;
  int frames = 50;
  double rate_hz = 10;
  // The light of frame `index`; both cameras share it, each with noise of its own.
  std::function<Illumination(int index)> light = [](int) { return Illumination::Day(); };
  // IMU readings, only if the rig has an IMU; its noise model is the rig's when rate_hz is 0.
  ImuSimulationOptions imu;
  // False: exact readings, whatever the noise model says.
  bool imu_noise = true;
};

// A sequence that renders its images when they are read; no file is involved. Thread-safe.
class SyntheticSequence : public Sequence {
 public:
  explicit SyntheticSequence(const SyntheticSequenceOptions& options = {});

  std::string name() const override { return "synthetic"; }
  const StereoRig& rig() const override { return options_.rig; }
  int size() const override { return options_.frames; }
  std::int64_t timestamp_ns(int index) const override { return states_[index].timestamp_ns; }
  const std::vector<ImuSample>& imu() const override { return imu_.samples; }
  const std::vector<std::string>& warnings() const override { return warnings_; }
  StereoPair Read(int index) const override;

  const SyntheticWorld& world() const { return world_; }
  const SyntheticTrajectory& trajectory() const { return options_.trajectory; }
  // The exact motion at each frame, and as poses of the body.
  const std::vector<BodyState>& states() const { return states_; }
  Trajectory ground_truth() const;
  const ImuRecording& imu_recording() const { return imu_; }

 private:
  SyntheticSequenceOptions options_;
  SyntheticWorld world_;
  ImageRenderer left_, right_;
  std::vector<BodyState> states_;
  ImuRecording imu_;
  std::vector<std::string> warnings_;
};

}  // namespace airslam
