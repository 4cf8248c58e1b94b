// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/dataset/trajectory.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <string>
#include <system_error>

#include "airslam/common/error.h"
#include "airslam/dataset/text_lines.h"

namespace airslam {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kNsPerSecond = 1'000'000'000;

struct Line {
  std::string file;
  int number = 0;

  template <typename... Args>
  [[noreturn]] void Fail(fmt::format_string<Args...> format, Args&&... args) const {
    airslam::Fail("{}:{}: {}", file, number, fmt::format(format, std::forward<Args>(args)...));
  }
};

struct PoseOfLine {
  StampedPose pose;
  int line = 0;
};

std::string SecondsText(std::int64_t ns) {
  const char* sign = ns < 0 ? "-" : "";
  const std::int64_t magnitude = ns < 0 ? -ns : ns;
  return fmt::format("{}{}.{:09d}", sign, magnitude / kNsPerSecond, magnitude % kNsPerSecond);
}

// `count` numbers from word `first` on.
std::vector<double> Numbers(const Words& words, std::size_t first, std::size_t count,
                            const Line& line) {
  std::vector<double> numbers;
  for (std::size_t i = first; i < first + count; ++i) {
    const std::optional<double> number = ParseDouble(words[i]);
    if (!number) line.Fail("\"{}\" is not a number", words[i]);
    numbers.push_back(*number);
  }
  return numbers;
}

Rigid3 PoseOf(const Eigen::Vector3d& translation, const Eigen::Quaterniond& rotation,
              const Line& line) {
  if (std::abs(rotation.norm() - 1) > 0.01) {
    line.Fail("the quaternion has the length {:.3f} instead of 1", rotation.norm());
  }
  return {rotation, translation};
}

StampedPose ParseEuroc(const Words& words, const Line& line) {
  if (words.size() < 8) line.Fail("expected a time, a position and a quaternion");
  const std::optional<std::int64_t> time = ParseTimeNs(words[0]);
  if (!time) line.Fail("\"{}\" is not a time in whole nanoseconds", words[0]);
  const std::vector<double> n = Numbers(words, 1, 7, line);
  return {*time, PoseOf({n[0], n[1], n[2]}, {n[3], n[4], n[5], n[6]}, line)};
}

StampedPose ParseTum(const Words& words, const Line& line) {
  if (words.size() != 8)
    line.Fail("expected 8 numbers (t x y z qx qy qz qw), got {}", words.size());
  std::optional<std::int64_t> time = ParseSecondsToNs(words[0]);
  if (!time) time = ParseTimeNs(words[0].substr(0, words[0].find('.')));  // nanoseconds
  if (!time) line.Fail("\"{}\" is not a time in seconds", words[0]);
  const std::vector<double> n = Numbers(words, 1, 7, line);
  return {*time, PoseOf({n[0], n[1], n[2]}, {n[6], n[3], n[4], n[5]}, line)};
}

StampedPose ParseKitti(const Words& words, const std::vector<std::int64_t>& times, int index,
                       const Line& line) {
  if (words.size() != 12) line.Fail("expected 12 numbers (a 3x4 matrix), got {}", words.size());
  const std::vector<double> n = Numbers(words, 0, 12, line);
  Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
  matrix.topRows<3>() = Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>>(n.data());
  const Eigen::Matrix3d rotation = matrix.topLeftCorner<3, 3>();
  if ((rotation * rotation.transpose() - Eigen::Matrix3d::Identity()).norm() > 0.01 ||
      rotation.determinant() < 0) {
    line.Fail("the 3x4 matrix holds no rotation");
  }
  if (!times.empty() && index >= static_cast<int>(times.size())) {
    line.Fail("times.txt beside the file has only {} lines", times.size());
  }
  return {times.empty() ? index * kNsPerSecond : times[index], Rigid3::FromMatrix(matrix)};
}

std::vector<std::int64_t> ReadTimes(const fs::path& file) {
  std::vector<std::int64_t> times;
  ForEachLine(file, [&](int number, const Words& words) {
    const std::optional<std::int64_t> time = ParseSecondsToNs(words[0]);
    if (!time) Fail("{}:{}: \"{}\" is not a time in seconds", file.string(), number, words[0]);
    times.push_back(*time);
  });
  return times;
}

// Words tell TUM from KITTI; a comma in the first line that holds data tells csv.
bool IsCsv(const fs::path& file) {
  std::ifstream stream(file);
  std::string line;
  while (std::getline(stream, line)) {
    if (!line.empty() && (std::isdigit(static_cast<unsigned char>(line[0])) || line[0] == '-')) {
      return line.find(',') != std::string::npos;
    }
  }
  return false;
}

void SortByTime(const fs::path& file, std::vector<PoseOfLine>* poses) {
  const auto earlier = [](const PoseOfLine& a, const PoseOfLine& b) {
    return a.pose.timestamp_ns < b.pose.timestamp_ns;
  };
  std::stable_sort(poses->begin(), poses->end(), earlier);
  for (std::size_t i = 1; i < poses->size(); ++i) {
    if (!earlier((*poses)[i - 1], (*poses)[i])) {
      Fail("{}:{}: the time {} occurs already in line {}", file.string(), (*poses)[i].line,
           SecondsText((*poses)[i].pose.timestamp_ns), (*poses)[i - 1].line);
    }
  }
}

}  // namespace

void WriteTum(const fs::path& file, const Trajectory& trajectory) {
  fmt::memory_buffer text;
  for (const StampedPose& pose : trajectory) {
    const Eigen::Vector3d& t = pose.world_from_body.translation;
    const Eigen::Quaterniond& q = pose.world_from_body.rotation;
    fmt::format_to(std::back_inserter(text),
                   "{} {:.9f} {:.9f} {:.9f} {:.9f} {:.9f} {:.9f} {:.9f}\n",
                   SecondsText(pose.timestamp_ns), t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w());
  }
  const fs::path temporary = file.string() + ".tmp";
  {
    std::ofstream stream(temporary, std::ios::binary | std::ios::trunc);
    stream.write(text.data(), static_cast<std::streamsize>(text.size()));
    stream.close();
    if (!stream) Fail("the trajectory {} cannot be written", temporary.string());
  }
  std::error_code error;
  fs::rename(temporary, file, error);
  if (error) Fail("the trajectory {} cannot be replaced: {}", file.string(), error.message());
}

Trajectory ReadTrajectory(const fs::path& file) {
  const bool is_csv = IsCsv(file);
  std::vector<std::int64_t> times;
  std::vector<PoseOfLine> poses;
  std::optional<bool> is_kitti;
  ForEachLine(file, [&](int number, const Words& words) {
    const Line line{file.string(), number};
    if (!is_kitti) {
      is_kitti = !is_csv && words.size() == 12;
      if (!is_csv && !*is_kitti && words.size() != 8) {
        line.Fail(
            "expected a TUM line (8 numbers), a KITTI line (12 numbers) or an EuRoC csv line, "
            "got {} words",
            words.size());
      }
      const fs::path times_txt = file.parent_path() / "times.txt";
      if (*is_kitti && fs::exists(times_txt)) times = ReadTimes(times_txt);
    }
    const int index = static_cast<int>(poses.size());
    poses.push_back({is_csv      ? ParseEuroc(words, line)
                     : *is_kitti ? ParseKitti(words, times, index, line)
                                 : ParseTum(words, line),
                     number});
  });
  if (poses.empty()) Fail("the trajectory {} holds no pose", file.string());
  SortByTime(file, &poses);

  Trajectory trajectory;
  trajectory.reserve(poses.size());
  for (const PoseOfLine& pose : poses) trajectory.push_back(pose.pose);
  return trajectory;
}

}  // namespace airslam
