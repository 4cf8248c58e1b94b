// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "airslam/map/map.h"

namespace airslam {

// What `airslam info` says about a map.
struct MapSummary {
  int format_version = 0;  // the file's
  std::string digest;      // MapDigest
  std::string model_pack;
  std::string model_pack_sha256;
  MapCalibration calibration;
  int keyframes = 0;
  int components = 0;
  double time_span_s = 0;    // from the first keyframe to the last
  double path_length_m = 0;  // along the keyframes' cameras, within components
  std::int64_t landmarks = 0;
  double observations_per_landmark = 0;  // mean number of keyframes that see one
  std::int64_t line_landmarks = 0;
  double observations_per_line_landmark = 0;
  std::int64_t keypoints = 0;
  std::int64_t lines = 0;  // of the keyframes, detected
  std::int64_t junctions = 0;
  std::int64_t file_bytes = 0;  // with a write-ahead log that was left behind
  double bytes_per_keyframe = 0;
};

// Reads and checks a map file. Throws Error as ReadMap does.
MapSummary SummarizeMap(const std::filesystem::path& file);

// As lines for people, and as JSON for programs (docs/map_format.md names the fields).
std::string FormatMapSummary(const MapSummary& summary);
nlohmann::json MapSummaryToJson(const MapSummary& summary);

}  // namespace airslam
