// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cstdlib>
#include <limits>
#include <string>
#include <vector>

#include "airslam/common/error.h"
#include "airslam/dataset/recorded_sequence.h"
#include "airslam/dataset/text_lines.h"
#include "airslam/sensor/calibration.h"

namespace airslam {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kMaxPairDifferenceNs = 5'000'000;
constexpr double kNsPerMs = 1e6;
constexpr double kNsPerSecond = 1e9;

struct ListedImage {
  std::int64_t timestamp_ns = 0;
  fs::path file;
};

std::vector<ListedImage> ReadImageCsv(const fs::path& camera) {
  const fs::path csv = camera / "data.csv";
  std::vector<ListedImage> images;
  ForEachLine(csv, [&](int number, const Words& words) {
    const auto time = words.empty() ? std::nullopt : ParseTimeNs(words[0]);
    if (words.size() < 2 || !time) {
      Fail("{}:{}: expected a time in nanoseconds and a file name", csv.string(), number);
    }
    if (!images.empty() && *time <= images.back().timestamp_ns) {
      Fail("{}:{}: the time {} is not later than the one before it, {}", csv.string(), number,
           *time, images.back().timestamp_ns);
    }
    images.push_back({*time, camera / "data" / std::string(words[1])});
  });
  if (images.empty()) Fail("{} lists no image", csv.string());
  return images;
}

// The images that data/ holds, when no data.csv says so: their names are their times.
std::vector<ListedImage> ListImageFolder(const fs::path& camera) {
  std::vector<ListedImage> images;
  for (const fs::directory_entry& entry : fs::directory_iterator(camera / "data")) {
    const auto time = ParseTimeNs(entry.path().stem().string());
    if (time && entry.is_regular_file()) images.push_back({*time, entry.path()});
  }
  std::sort(images.begin(), images.end(), [](const ListedImage& a, const ListedImage& b) {
    return a.timestamp_ns < b.timestamp_ns;
  });
  for (std::size_t i = 1; i < images.size(); ++i) {
    if (images[i].timestamp_ns == images[i - 1].timestamp_ns) {
      Fail("the images {} and {} claim the same time", images[i - 1].file.string(),
           images[i].file.string());
    }
  }
  return images;
}

std::vector<ListedImage> ReadImageList(const fs::path& camera, std::vector<std::string>* warnings) {
  if (!fs::is_directory(camera)) Fail("the folder {} is missing", camera.string());
  if (fs::exists(camera / "data.csv")) return ReadImageCsv(camera);
  std::vector<ListedImage> images;
  if (fs::is_directory(camera / "data")) images = ListImageFolder(camera);
  if (images.empty()) {
    Fail("the file {} is missing, and no image in {} is named by its time in nanoseconds",
         (camera / "data.csv").string(), (camera / "data").string());
  }
  warnings->push_back(fmt::format("{} is missing: the {} images in data/ are taken by their names",
                                  (camera / "data.csv").string(), images.size()));
  return images;
}

// Half of the median time between two images, at most 5 ms.
std::int64_t PairTolerance(const std::vector<ListedImage>& images) {
  std::vector<std::int64_t> periods;
  for (std::size_t i = 1; i < images.size(); ++i) {
    periods.push_back(images[i].timestamp_ns - images[i - 1].timestamp_ns);
  }
  if (periods.empty()) return kMaxPairDifferenceNs;
  std::nth_element(periods.begin(), periods.begin() + periods.size() / 2, periods.end());
  return std::min(kMaxPairDifferenceNs, periods[periods.size() / 2] / 2);
}

std::vector<RecordedFrame> PairByTime(const std::vector<ListedImage>& left,
                                      const std::vector<ListedImage>& right,
                                      std::vector<std::string>* warnings) {
  const std::int64_t tolerance = PairTolerance(left);
  std::vector<RecordedFrame> frames;
  std::int64_t closest = std::numeric_limits<std::int64_t>::max();
  for (std::size_t i = 0, j = 0; i < left.size() && j < right.size();) {
    const std::int64_t difference = right[j].timestamp_ns - left[i].timestamp_ns;
    closest = std::min<std::int64_t>(closest, std::llabs(difference));
    if (std::llabs(difference) <= tolerance) {
      frames.push_back({left[i].timestamp_ns, left[i].file, right[j].file});
      ++i, ++j;
    } else {
      ++(difference > 0 ? i : j);
    }
  }
  if (frames.empty()) {
    Fail(
        "the left and right images were never taken at the same time: the closest two are {:.3f} "
        "ms "
        "apart, {:.3f} ms are allowed",
        closest / kNsPerMs, tolerance / kNsPerMs);
  }
  const std::size_t lone_left = left.size() - frames.size();
  const std::size_t lone_right = right.size() - frames.size();
  if (lone_left + lone_right > 0) {
    warnings->push_back(
        fmt::format("{} left and {} right images have no partner within {:.3f} ms and are dropped",
                    lone_left, lone_right, tolerance / kNsPerMs));
  }
  return frames;
}

ImuSample ParseImuLine(const fs::path& csv, int number, const Words& words) {
  const auto time = ParseTimeNs(words[0]);
  if (words.size() < 7 || !time) {
    Fail("{}:{}: expected a time in nanoseconds and 6 numbers", csv.string(), number);
  }
  ImuSample sample;
  sample.timestamp_ns = *time;
  for (int i = 0; i < 6; ++i) {
    const auto value = ParseDouble(words[i + 1]);
    if (!value) Fail("{}:{}: \"{}\" is not a number", csv.string(), number, words[i + 1]);
    (i < 3 ? sample.angular_velocity : sample.acceleration)[i % 3] = *value;
  }
  return sample;
}

std::vector<ImuSample> ReadImuCsv(const fs::path& csv, std::vector<std::string>* warnings) {
  std::vector<ImuSample> samples;
  int duplicates = 0, reversed = 0;
  ForEachLine(csv, [&](int number, const Words& words) {
    const ImuSample sample = ParseImuLine(csv, number, words);
    if (!samples.empty() && sample.timestamp_ns <= samples.back().timestamp_ns) {
      ++(sample.timestamp_ns == samples.back().timestamp_ns ? duplicates : reversed);
      return;
    }
    samples.push_back(sample);
  });
  if (duplicates > 0) {
    warnings->push_back(fmt::format("{}: {} samples repeat the time before them and are dropped",
                                    csv.string(), duplicates));
  }
  if (reversed > 0) {
    warnings->push_back(
        fmt::format("{}: {} samples go back in time and are dropped", csv.string(), reversed));
  }
  return samples;
}

// Says where the IMU has no data although there are images.
void WarnOfGaps(const Recording& recording, std::vector<std::string>* warnings) {
  const std::vector<ImuSample>& imu = recording.imu;
  const std::int64_t begin = recording.frames.front().timestamp_ns;
  const std::int64_t end = recording.frames.back().timestamp_ns;
  if (imu.empty() || imu.front().timestamp_ns > begin || imu.back().timestamp_ns < end) {
    warnings->push_back("the IMU's samples do not cover the time of all images");
  }
  int gaps = 0;
  std::int64_t longest = 0;
  const double allowed = 10 * kNsPerSecond / recording.rig.imu->rate_hz;
  for (std::size_t i = 1; i < imu.size(); ++i) {
    const std::int64_t gap = imu[i].timestamp_ns - imu[i - 1].timestamp_ns;
    if (static_cast<double>(gap) > allowed) ++gaps;
    longest = std::max(longest, gap);
  }
  if (gaps > 0) {
    warnings->push_back(fmt::format("the IMU's samples have {} gaps, the longest of {:.3f} s", gaps,
                                    longest / kNsPerSecond));
  }
}

// The first file `<prefix>*.yaml` of the folder by name, or an empty path.
fs::path FindYaml(const fs::path& folder, const std::string& prefix) {
  fs::path found;
  if (!fs::is_directory(folder)) return found;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder)) {
    const fs::path& path = entry.path();
    if (path.extension() != ".yaml" || !path.filename().string().starts_with(prefix)) continue;
    if (found.empty() || path < found) found = path;
  }
  return found;
}

// The sensor.yaml files of EuRoC, else Kalibr's results beside or inside mav0, or in dso/ (TUM-VI).
StereoRig ReadRig(const fs::path& root, const fs::path& mav0) {
  if (fs::exists(mav0 / "cam0" / "sensor.yaml")) return ReadEurocRig(mav0);
  for (const fs::path& folder : {root, mav0, root / "dso"}) {
    const fs::path camchain = FindYaml(folder, "camchain");
    if (!camchain.empty()) return ReadKalibrRig(camchain, FindYaml(folder, "imu"));
  }
  Fail("no calibration found: neither {} nor a Kalibr camchain*.yaml in {}",
       (mav0 / "cam0" / "sensor.yaml").string(), root.string());
}

}  // namespace

Recording ReadEuroc(const fs::path& folder) {
  const fs::path mav0 = fs::is_directory(folder / "mav0") ? folder / "mav0" : folder;
  Recording recording;
  recording.name = "EuRoC";
  const std::vector<ListedImage> left = ReadImageList(mav0 / "cam0", &recording.warnings);
  const std::vector<ListedImage> right = ReadImageList(mav0 / "cam1", &recording.warnings);
  recording.frames = PairByTime(left, right, &recording.warnings);
  recording.rig = ReadRig(folder, mav0);
  const fs::path imu_csv = mav0 / "imu0" / "data.csv";
  if (recording.rig.imu && fs::exists(imu_csv)) {
    recording.imu = ReadImuCsv(imu_csv, &recording.warnings);
    WarnOfGaps(recording, &recording.warnings);
  } else if (recording.rig.imu) {
    recording.warnings.push_back(fmt::format("{} is missing: no IMU is used", imu_csv.string()));
  } else if (fs::exists(imu_csv)) {
    recording.warnings.push_back(
        fmt::format("{} is not used: the calibration has no IMU", imu_csv.string()));
  }
  return recording;
}

}  // namespace airslam
