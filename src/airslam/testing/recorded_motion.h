// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstdint>
#include <filesystem>
#include <vector>

#include "airslam/common/error.h"
#include "airslam/dataset/text_lines.h"
#include "airslam/geometry/rigid3.h"
#include "airslam/sensor/imu.h"

namespace airslam {

// One line of an EuRoC state_groundtruth_estimate0/data.csv.
struct RecordedState {
  std::int64_t timestamp_ns = 0;
  Rigid3 world_from_body;
  Eigen::Vector3d velocity_in_world = Eigen::Vector3d::Zero();
  Eigen::Vector3d gyroscope_bias = Eigen::Vector3d::Zero();
  Eigen::Vector3d accelerometer_bias = Eigen::Vector3d::Zero();
};

// Rows of numbers of a csv or text file. With `times` the first column goes there as integers.
inline std::vector<std::vector<double>> ReadRows(const std::filesystem::path& file,
                                                 std::vector<std::int64_t>* times = nullptr) {
  std::vector<std::vector<double>> rows;
  ForEachLine(file, [&](int number, const Words& words) {
    std::size_t first = 0;
    if (times != nullptr) times->push_back(ParseInteger(words.at(first++)).value());
    std::vector<double>& row = rows.emplace_back();
    for (std::size_t i = first; i < words.size(); ++i) {
      const auto value = ParseDouble(words[i]);
      if (!value) Fail("{}:{}: \"{}\" is not a number", file.string(), number, words[i]);
      row.push_back(*value);
    }
  });
  return rows;
}

inline std::vector<RecordedState> ReadRecordedStates(const std::filesystem::path& csv) {
  std::vector<std::int64_t> times;
  const auto rows = ReadRows(csv, &times);
  std::vector<RecordedState> states;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const double* r = rows[i].data();
    RecordedState state;
    state.timestamp_ns = times[i];
    state.world_from_body =
        Rigid3(Eigen::Quaterniond(r[3], r[4], r[5], r[6]), Eigen::Vector3d(r[0], r[1], r[2]));
    state.velocity_in_world = Eigen::Vector3d(r[7], r[8], r[9]);
    state.gyroscope_bias = Eigen::Vector3d(r[10], r[11], r[12]);
    state.accelerometer_bias = Eigen::Vector3d(r[13], r[14], r[15]);
    states.push_back(state);
  }
  return states;
}

inline std::vector<ImuSample> ReadRecordedImu(const std::filesystem::path& csv) {
  std::vector<std::int64_t> times;
  const auto rows = ReadRows(csv, &times);
  std::vector<ImuSample> samples;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const double* r = rows[i].data();
    samples.push_back({times[i], {r[0], r[1], r[2]}, {r[3], r[4], r[5]}});
  }
  return samples;
}

}  // namespace airslam
