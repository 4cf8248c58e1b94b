// SPDX-License-Identifier: BSD-3-Clause
#include <map>
#include <string>
#include <vector>

#include "airslam/common/error.h"
#include "airslam/dataset/image_file.h"
#include "airslam/dataset/recorded_sequence.h"
#include "airslam/dataset/text_lines.h"
#include "airslam/sensor/calibration.h"

namespace airslam {
namespace {

namespace fs = std::filesystem;

// Image files by the number that is their name.
using NumberedImages = std::map<std::int64_t, fs::path>;

NumberedImages ListNumberedImages(const fs::path& folder) {
  if (!fs::is_directory(folder)) Fail("the folder {} is missing", folder.string());
  NumberedImages images;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder)) {
    const std::string extension = entry.path().extension().string();
    if (extension != ".png" && extension != ".jpg" && extension != ".jpeg") continue;
    const auto number = ParseInteger(entry.path().stem().string());
    if (!number || *number < 0) continue;
    if (!images.emplace(*number, entry.path()).second) {
      Fail("the folder {} holds two images with the number {}", folder.string(), *number);
    }
  }
  if (images.empty()) {
    Fail("the folder {} holds no image named by its number (000000.png or .jpg)", folder.string());
  }
  return images;
}

std::vector<std::int64_t> ReadTimes(const fs::path& file) {
  std::vector<std::int64_t> times;
  ForEachLine(file, [&](int number, const Words& words) {
    const auto time = ParseSecondsToNs(words[0]);
    if (!time) Fail("{}:{}: \"{}\" is not a time in seconds", file.string(), number, words[0]);
    if (!times.empty() && *time <= times.back()) {
      Fail("{}:{}: the time {} is not later than the one before it", file.string(), number,
           words[0]);
    }
    times.push_back(*time);
  });
  return times;
}

std::vector<RecordedFrame> Pair(const fs::path& folder, const NumberedImages& left,
                                const NumberedImages& right,
                                const std::vector<std::int64_t>& times) {
  if (left.size() != right.size()) {
    Fail("{} holds {} images, but image_1 beside it holds {}", (folder / "image_0").string(),
         left.size(), right.size());
  }
  std::vector<RecordedFrame> frames;
  for (const auto& [number, file] : left) {
    const auto partner = right.find(number);
    if (partner == right.end()) {
      Fail("the image {} has no partner in image_1", file.string());
    }
    if (number >= static_cast<std::int64_t>(times.size())) {
      Fail("{} has only {} lines, but there is an image {}", (folder / "times.txt").string(),
           times.size(), file.string());
    }
    frames.push_back({times[number], file, partner->second});
  }
  return frames;
}

// The size is not in calib.txt: it is that of the first image that can be read.
cv::Size FirstImageSize(const NumberedImages& images) {
  constexpr int kTries = 5;
  int tries = 0;
  for (const auto& [number, file] : images) {
    try {
      return DecodeGrey(file).size();
    } catch (const Error&) {
      if (++tries == kTries || tries == static_cast<int>(images.size())) throw;
    }
  }
  return {};
}

}  // namespace

Recording ReadKitti(const fs::path& folder) {
  Recording recording;
  recording.name = "KITTI";
  const NumberedImages left = ListNumberedImages(folder / "image_0");
  const NumberedImages right = ListNumberedImages(folder / "image_1");
  const std::vector<std::int64_t> times = ReadTimes(folder / "times.txt");
  recording.frames = Pair(folder, left, right, times);
  if (times.size() > left.size()) {
    recording.warnings.push_back(fmt::format("{} lists {} times, but there are only {} image pairs",
                                             (folder / "times.txt").string(), times.size(),
                                             left.size()));
  }
  const cv::Size size = FirstImageSize(left);
  recording.rig = ReadKittiRig(folder / "calib.txt", size.width, size.height);
  if (times.size() > 1)
    recording.rig.rate_hz = 1e9 * (times.size() - 1) / (times.back() - times[0]);
  return recording;
}

}  // namespace airslam
