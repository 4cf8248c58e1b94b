// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/dataset/recorded_sequence.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "airslam/common/error.h"
#include "airslam/dataset/image_file.h"

namespace airslam {
namespace {

// How many frames may be broken at the start before the whole sequence counts as unreadable.
constexpr std::size_t kProbes = 5;

void CheckSize(const cv::Mat& image, const std::filesystem::path& file, const Pinhole& calibrated) {
  if (image.cols != calibrated.width || image.rows != calibrated.height) {
    Fail("wrong resolution: the image {} has {}x{} pixels, but the calibration says {}x{}",
         file.string(), image.cols, image.rows, calibrated.width, calibrated.height);
  }
}

class RecordedSequence : public Sequence {
 public:
  explicit RecordedSequence(Recording recording) : recording_(std::move(recording)) { Probe(); }

  std::string name() const override { return recording_.name; }
  const StereoRig& rig() const override { return recording_.rig; }
  int size() const override { return static_cast<int>(recording_.frames.size()); }
  std::int64_t timestamp_ns(int index) const override {
    return recording_.frames.at(index).timestamp_ns;
  }
  const std::vector<ImuSample>& imu() const override { return recording_.imu; }
  const std::vector<std::string>& warnings() const override { return recording_.warnings; }

  StereoPair Read(int index) const override {
    const RecordedFrame& frame = recording_.frames.at(index);
    return {frame.timestamp_ns, ReadImage(frame.left, recording_.rig.left),
            ReadImage(frame.right, recording_.rig.right)};
  }

 private:
  cv::Mat ReadImage(const std::filesystem::path& file, const RigCamera& camera) const {
    const cv::Mat grey = DecodeGrey(file);
    CheckSize(grey, file, camera.camera.pinhole);
    return ToEightBit(grey, twelve_bit_);
  }

  // Compares the first readable pair with the calibration, and learns how 16-bit images are scaled.
  void Probe() {
    const std::vector<RecordedFrame>& frames = recording_.frames;
    std::string first_problem;
    for (std::size_t i = 0; i < std::min(frames.size(), kProbes); ++i) {
      cv::Mat left, right;
      try {
        left = DecodeGrey(frames[i].left);
        right = DecodeGrey(frames[i].right);
      } catch (const Error& error) {
        if (first_problem.empty()) first_problem = error.what();
        continue;
      }
      CheckSize(left, frames[i].left, recording_.rig.left.camera.pinhole);
      CheckSize(right, frames[i].right, recording_.rig.right.camera.pinhole);
      if (left.depth() == CV_16U) twelve_bit_ = HoldsTwelveBits();
      return;
    }
    Fail("none of the first {} image pairs can be read: {}", std::min(frames.size(), kProbes),
         first_problem);
  }

  // Whether no pixel of a few 16-bit images, spread over the sequence, exceeds 12 bits. One answer
  // for the whole sequence: the scale must not change from frame to frame.
  bool HoldsTwelveBits() const {
    const std::size_t count = recording_.frames.size();
    for (std::size_t i = 0; i < kProbes; ++i) {
      const std::size_t index = i * (count - 1) / (kProbes - 1);
      try {
        const cv::Mat image = DecodeGrey(recording_.frames[index].left);
        double largest = 0;
        cv::minMaxIdx(image, nullptr, &largest);
        if (largest > 4095) return false;
      } catch (const Error&) {
        continue;  // a broken frame shows nothing
      }
    }
    return true;
  }

  Recording recording_;
  bool twelve_bit_ = false;
};

}  // namespace

std::unique_ptr<Sequence> MakeSequence(Recording recording) {
  if (recording.frames.empty()) Fail("the sequence holds no stereo pair");
  return std::make_unique<RecordedSequence>(std::move(recording));
}

}  // namespace airslam
