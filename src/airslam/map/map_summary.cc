// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/map/map_summary.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "airslam/map/map_file.h"

namespace airslam {
namespace {

std::int64_t FileBytes(const std::filesystem::path& file) {
  std::int64_t bytes = 0;
  for (const char* suffix : {"", "-wal"}) {
    std::error_code error;
    const std::uintmax_t size = std::filesystem::file_size(file.string() + suffix, error);
    if (!error) bytes += static_cast<std::int64_t>(size);
  }
  return bytes;
}

void SummarizeKeyframes(const Map& map, MapSummary& summary) {
  std::map<int, const Keyframe*> last_of_component;
  for (const auto& [id, keyframe] : map.keyframes) {
    const Keyframe*& last = last_of_component[keyframe.component];
    if (last != nullptr) {
      summary.path_length_m +=
          (keyframe.world_from_cam.translation - last->world_from_cam.translation).norm();
    }
    last = &keyframe;
    summary.keypoints += std::ssize(keyframe.keypoints);
    summary.lines += std::ssize(keyframe.lines);
    summary.junctions += std::ssize(keyframe.junctions);
  }
  summary.keyframes = static_cast<int>(map.keyframes.size());
  summary.components = static_cast<int>(last_of_component.size());
  if (map.keyframes.empty()) return;
  const auto [first, last] = std::minmax_element(
      map.keyframes.begin(), map.keyframes.end(),
      [](const auto& a, const auto& b) { return a.second.timestamp_ns < b.second.timestamp_ns; });
  summary.time_span_s =
      static_cast<double>(last->second.timestamp_ns - first->second.timestamp_ns) * 1e-9;
}

// Mean number of keyframes that see a landmark; `seen` is the column of a keyframe that names them.
double ObservationsPerLandmark(const Map& map, std::vector<LandmarkId> Keyframe::*seen,
                               std::size_t landmarks) {
  if (landmarks == 0) return 0;
  std::size_t observations = 0;
  for (const auto& [id, keyframe] : map.keyframes) {
    std::set<LandmarkId> ids((keyframe.*seen).begin(), (keyframe.*seen).end());
    ids.erase(kNoLandmark);
    observations += ids.size();
  }
  return static_cast<double>(observations) / static_cast<double>(landmarks);
}

}  // namespace

MapSummary SummarizeMap(const std::filesystem::path& file) {
  const Map map = ReadMap(file);
  MapSummary summary;
  summary.format_version = ReadMapVersion(file);
  summary.digest = MapDigest(file);
  summary.model_pack = map.model_pack;
  summary.model_pack_sha256 = map.model_pack_sha256;
  summary.calibration = map.calibration;
  SummarizeKeyframes(map, summary);
  summary.landmarks = std::ssize(map.landmarks);
  summary.observations_per_landmark =
      ObservationsPerLandmark(map, &Keyframe::landmarks, map.landmarks.size());
  summary.line_landmarks = std::ssize(map.line_landmarks);
  summary.observations_per_line_landmark =
      ObservationsPerLandmark(map, &Keyframe::line_landmarks, map.line_landmarks.size());
  summary.file_bytes = FileBytes(file);
  if (summary.keyframes > 0) {
    summary.bytes_per_keyframe = static_cast<double>(summary.file_bytes) / summary.keyframes;
  }
  return summary;
}

std::string FormatMapSummary(const MapSummary& s) {
  const Pinhole& camera = s.calibration.stereo.camera;
  std::string text;
  const auto line = [&text](std::string_view name, const std::string& value) {
    text += fmt::format("{:<16}{}\n", name, value);
  };
  line("format", std::to_string(s.format_version));
  line("camera",
       fmt::format("{}x{} pixels, fx {:.3f} fy {:.3f} cx {:.3f} cy {:.3f}, rectified", camera.width,
                   camera.height, camera.fx, camera.fy, camera.cx, camera.cy));
  line("baseline", fmt::format("{:.5f} m", s.calibration.stereo.baseline));
  line("body", s.calibration.has_imu ? "IMU" : "left camera");
  line("model pack", fmt::format("{} ({})", s.model_pack, s.model_pack_sha256));
  line("keyframes", fmt::format("{} in {} {}", s.keyframes, s.components,
                                s.components == 1 ? "component" : "components"));
  line("time span", fmt::format("{:.3f} s", s.time_span_s));
  line("path length", fmt::format("{:.3f} m", s.path_length_m));
  line("landmarks",
       fmt::format("{}, seen by {:.2f} keyframes each", s.landmarks, s.observations_per_landmark));
  line("line landmarks", fmt::format("{}, seen by {:.2f} keyframes each", s.line_landmarks,
                                     s.observations_per_line_landmark));
  line("keypoints", std::to_string(s.keypoints));
  line("lines", fmt::format("{} with {} junctions", s.lines, s.junctions));
  line("file", fmt::format("{} bytes, {:.0f} a keyframe", s.file_bytes, s.bytes_per_keyframe));
  line("digest", s.digest);
  return text;
}

nlohmann::json MapSummaryToJson(const MapSummary& s) {
  const Pinhole& camera = s.calibration.stereo.camera;
  const Rigid3& body_from_left = s.calibration.body_from_left;
  const Eigen::Vector3d& t = body_from_left.translation;
  const Eigen::Quaterniond& q = body_from_left.rotation;
  return {{"format_version", s.format_version},
          {"digest", s.digest},
          {"model_pack", {{"name", s.model_pack}, {"sha256", s.model_pack_sha256}}},
          {"calibration",
           {{"width", camera.width},
            {"height", camera.height},
            {"fx", camera.fx},
            {"fy", camera.fy},
            {"cx", camera.cx},
            {"cy", camera.cy},
            {"baseline_m", s.calibration.stereo.baseline},
            {"body_from_left",
             {{"translation_m", {t.x(), t.y(), t.z()}},
              {"quaternion_xyzw", {q.x(), q.y(), q.z(), q.w()}}}},
            {"has_imu", s.calibration.has_imu}}},
          {"keyframes", s.keyframes},
          {"components", s.components},
          {"time_span_s", s.time_span_s},
          {"path_length_m", s.path_length_m},
          {"landmarks", s.landmarks},
          {"observations_per_landmark", s.observations_per_landmark},
          {"line_landmarks", s.line_landmarks},
          {"observations_per_line_landmark", s.observations_per_line_landmark},
          {"keypoints", s.keypoints},
          {"lines", s.lines},
          {"junctions", s.junctions},
          {"file_bytes", s.file_bytes},
          {"bytes_per_keyframe", s.bytes_per_keyframe}};
}

}  // namespace airslam
