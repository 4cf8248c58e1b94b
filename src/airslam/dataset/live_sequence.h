// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "airslam/dataset/sequence.h"

namespace airslam {

// A sequence that is being recorded while it is read: one side adds frames and IMU readings as they
// come, the pipeline on other threads reads them, and waits for them. Whatever the pace, what it
// reads is that of the whole sequence, recorded. Every call of the adding side throws Error, taking
// nothing in, for what cannot be right. One thread adds, any number read.
class LiveSequence : public Sequence {
 public:
  // `expects_imu`: the pipeline waits for the readings that a frame needs, until EndImu().
  // A rig without IMU expects none.
  LiveSequence(const StereoRig& rig, bool expects_imu);

  // A reading, in the IMU's own time. Throws Error when it is not finite or its time is not after
  // the last one's.
  void AddImu(const ImuSample& sample);
  // A pair, CV_8UC1 each of the calibrated size, copied. Waits while enough frames wait to be read.
  // Throws Error when the images are of another kind or size, the time is not after the last one's,
  // or so many frames wait for the readings of the IMU that these seem to have stopped.
  void AddFrame(const StereoPair& pair);
  // No reading will come any more: frames go on without.
  void EndImu();
  // Nothing will come any more: what has been added is read, then the sequence ends.
  void End();

  // The reading side.
  std::string name() const override { return "live"; }
  const StereoRig& rig() const override { return rig_; }
  int size() const override;  // frames added so far
  std::int64_t timestamp_ns(int index) const override;
  bool Has(int index) const override;         // waits for the frame or the end
  StereoPair Read(int index) const override;  // each frame once, in order
  const std::vector<ImuSample>& imu() const override { return no_samples_; }
  bool has_more_imu() const override { return expects_imu_; }
  std::vector<ImuSample> MoreImu(std::int64_t until_ns) const override;
  void Abandon() const override;  // the adding side is then told that the run is over
  bool abandoned() const;
  const std::vector<std::string>& warnings() const override { return no_warnings_; }

 private:
  void CheckImage(const cv::Mat& image, const RigCamera& camera, const char* side) const;

  const StereoRig rig_;
  const bool expects_imu_;
  const std::vector<ImuSample> no_samples_;
  const std::vector<std::string> no_warnings_;

  mutable std::mutex mutex_;
  mutable std::condition_variable changed_;
  mutable std::deque<StereoPair> waiting_;  // frames not read yet
  mutable int read_ = 0;                    // frames read
  std::vector<std::int64_t> times_;         // of all frames
  mutable std::vector<ImuSample> samples_;  // readings not taken yet
  std::optional<std::int64_t> last_imu_ns_;
  mutable bool waits_for_imu_ = false;  // the reading side does
  bool imu_ended_ = false;
  bool ended_ = false;
  mutable bool abandoned_ = false;
};

}  // namespace airslam
