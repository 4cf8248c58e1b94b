// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "airslam/sensor/imu.h"
#include "airslam/sensor/rig.h"

namespace airslam {

// One synchronised raw stereo pair, CV_8UC1 each.
struct StereoPair {
  std::int64_t timestamp_ns = 0;
  cv::Mat left;
  cv::Mat right;
};

// A recorded stereo sequence. Opening it reads the lists and the calibration, not the images.
class Sequence {
 public:
  virtual ~Sequence() = default;

  virtual std::string name() const = 0;  // e.g. "EuRoC", for messages
  virtual const StereoRig& rig() const = 0;
  // Number of synchronised pairs, in order of strictly increasing time.
  virtual int size() const = 0;
  virtual std::int64_t timestamp_ns(int index) const = 0;
  // All IMU samples, in order of time; empty without an IMU.
  virtual const std::vector<ImuSample>& imu() const = 0;
  // What was odd but survivable while opening (unpaired images dropped, say), a sentence each.
  virtual const std::vector<std::string>& warnings() const = 0;

  // Decodes a pair; 16-bit and colour images become 8-bit grey. Thread-safe. Throws Error with one
  // sentence when an image is missing, unreadable or not of the calibrated size; the caller may
  // skip the frame.
  virtual StereoPair Read(int index) const = 0;

  // A sequence that is being recorded while it is read (LiveSequence) overrides these.
  // Whether there is a frame `index`; waits until it is there or none will come.
  virtual bool Has(int index) const { return index < size(); }
  // Whether readings of the IMU come with time, through MoreImu(), instead of all in imu().
  virtual bool has_more_imu() const { return false; }
  // Those that have come since the last call, in order of time; waits until one at or after
  // `until_ns`, in the IMU's own time, is among those that have come so far, or none will come.
  virtual std::vector<ImuSample> MoreImu(std::int64_t /*until_ns*/) const { return {}; }
  // The reader needs no more: wakes whoever waits in the calls above.
  virtual void Abandon() const {}
};

// Recognises the layout of `folder`: EuRoC ASL (holds mav0, or is mav0) or KITTI odometry (holds
// image_0, image_1, calib.txt, times.txt). Throws Error when it is neither, holds no pair, its
// timestamps go back, or the calibration does not match the images.
//
// EuRoC: the calibration is that of the sensor.yaml files; without them that of Kalibr's
// camchain*.yaml and imu*.yaml beside mav0, inside it or in dso/ (TUM-VI). Left and right images
// are paired by time within half of the frame period, at most 5 ms. The pair has the left image's
// time. Without data.csv, images named by their nanoseconds are taken as they are, with a warning.
// 16-bit images are shifted to 8 bits, by 4 if no pixel of five of them exceeds 4095, else by 8.
std::unique_ptr<Sequence> OpenSequence(const std::filesystem::path& folder);

}  // namespace airslam
