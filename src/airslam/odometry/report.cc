// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/report.h"

#include <algorithm>
#include <fstream>
#include <map>

#include "airslam/common/error.h"
#include "airslam/map/keyframe_trajectory.h"

namespace airslam {
namespace {

Rigid3 CamFromBody(const PipelineResult& result) {
  return result.map.calibration.body_from_left.Inverse();
}

// Runs of frames without a pose.
nlohmann::json LostIntervals(const std::vector<FrameRecord>& records) {
  nlohmann::json intervals = nlohmann::json::array();
  for (std::size_t i = 0; i < records.size();) {
    std::size_t end = i;
    while (end < records.size() && !records[end].has_pose()) ++end;
    if (end > i) {
      intervals.push_back({{"from_ns", records[i].timestamp_ns},
                           {"to_ns", records[end - 1].timestamp_ns},
                           {"frames", end - i}});
    }
    i = end + 1;
  }
  return intervals;
}

nlohmann::json FrameStates(const std::vector<FrameRecord>& records) {
  nlohmann::json frames = nlohmann::json::array();
  for (const FrameRecord& record : records) {
    frames.push_back({{"timestamp_ns", record.timestamp_ns},
                      {"state", StateName(record.state)},
                      {"component", record.component},
                      {"tracked_points", record.tracked_points},
                      {"keyframe", record.is_keyframe},
                      {"used_matcher", record.used_matcher},
                      {"ms", record.milliseconds}});
  }
  return frames;
}

nlohmann::json ToJson(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

nlohmann::json ToJson(const ImuBias& bias) {
  return {{"gyroscope", ToJson(bias.gyroscope)}, {"accelerometer", ToJson(bias.accelerometer)}};
}

nlohmann::json InertialReport(const InertialSummary& inertial) {
  nlohmann::json json = {{"state", inertial.state},
                         {"reason", inertial.reason},
                         {"readings", inertial.readings},
                         {"dropped_readings", inertial.dropped},
                         {"calibrated_time_offset_s", inertial.calibrated_time_offset},
                         {"time_offset_s", inertial.time_offset},
                         {"final_bias", ToJson(inertial.final_bias)},
                         {"starts", nlohmann::json::array()},
                         {"gaps", nlohmann::json::array()}};
  for (const InertialStart& start : inertial.starts) {
    json["starts"].push_back({{"component", start.component},
                              {"timestamp_ns", start.timestamp_ns},
                              {"seconds", start.seconds},
                              {"at_rest", start.at_rest},
                              {"span_s", start.span},
                              {"refinements", start.refinements},
                              {"bias", ToJson(start.bias)},
                              {"gravity_sigma_rad", start.gravity_sigma},
                              {"gyroscope_bias_sigma", start.gyroscope_bias_sigma},
                              {"accelerometer_bias_sigma", start.accelerometer_bias_sigma}});
  }
  for (const InertialSummary::Gap& gap : inertial.gaps) {
    json["gaps"].push_back({{"from_ns", gap.begin_ns}, {"to_ns", gap.end_ns}});
  }
  return json;
}

// How many lines the keyframes have, and how many of them were found in the right image and see a
// line of the map.
nlohmann::json LineReport(const Map& map) {
  std::int64_t detected = 0, stereo = 0, observations = 0, junctions = 0;
  for (const auto& [id, keyframe] : map.keyframes) {
    detected += std::ssize(keyframe.lines);
    junctions += std::ssize(keyframe.junctions);
    stereo += std::count_if(keyframe.right_lines.begin(), keyframe.right_lines.end(),
                            [](const LineSegment& line) { return line.score >= 0; });
    observations += std::count_if(keyframe.line_landmarks.begin(), keyframe.line_landmarks.end(),
                                  [](LandmarkId line) { return line != kNoLandmark; });
  }
  return {{"detected", detected},
          {"junctions", junctions},
          {"stereo_matched", stereo},
          {"observations", observations},
          {"landmarks", map.line_landmarks.size()}};
}

nlohmann::json StageTable(const StageTimes& times) {
  nlohmann::json stages = nlohmann::json::object();
  for (const auto& [name, s] : times.Summarize()) {
    stages[name] = {{"count", s.count},   {"mean_ms", s.mean_ms}, {"median_ms", s.median_ms},
                    {"p95_ms", s.p95_ms}, {"max_ms", s.max_ms},   {"total_ms", s.total_ms}};
  }
  return stages;
}

}  // namespace

const char* StateName(FrameState state) {
  switch (state) {
    case FrameState::kInitialized:
      return "initialized";
    case FrameState::kTracked:
      return "tracked";
    case FrameState::kInertial:
      return "inertial";
    case FrameState::kLost:
      return "lost";
    case FrameState::kSkipped:
      return "skipped";
  }
  return "unknown";
}

int LargestComponent(const PipelineResult& result) {
  std::map<int, int> frames;
  for (const FrameRecord& record : result.records) {
    if (record.has_pose()) ++frames[record.component];
  }
  int largest = -1;
  for (const auto& [component, count] : frames) {
    if (largest < 0 || count > frames[largest]) largest = component;
  }
  return largest;
}

Trajectory FinalTrajectory(const PipelineResult& result, int component) {
  const Rigid3 cam_from_body = CamFromBody(result);
  Trajectory trajectory;
  for (const FrameRecord& record : result.records) {
    if (!record.has_pose() || record.component != component) continue;
    const Rigid3& world_from_reference = result.map.keyframes.at(record.reference).world_from_cam;
    trajectory.push_back(
        {record.timestamp_ns, world_from_reference * record.reference_from_cam * cam_from_body});
  }
  return trajectory;
}

Trajectory OnlineTrajectory(const PipelineResult& result, int component) {
  const Rigid3 cam_from_body = CamFromBody(result);
  Trajectory trajectory;
  for (const FrameRecord& record : result.records) {
    if (!record.has_pose() || record.component != component) continue;
    trajectory.push_back({record.timestamp_ns, record.online_world_from_cam * cam_from_body});
  }
  return trajectory;
}

Trajectory KeyframeTrajectory(const PipelineResult& result, int component) {
  return MapTrajectory(result.map, component);
}

nlohmann::json MakeReport(const PipelineResult& result, const StageTimes& times,
                          const RunInfo& info) {
  const std::vector<FrameRecord>& records = result.records;
  const auto count = [&](auto&& predicate) {
    return std::count_if(records.begin(), records.end(), predicate);
  };
  int components = 0;
  for (const FrameRecord& record : records) {
    components = std::max(components, record.component + 1);
  }
  nlohmann::json report;
  report["format"] = 1;
  report["dataset"] = info.dataset;
  report["model_pack"] = info.model_pack;
  report["options"] = info.options_yaml;
  report["frames"] = records.size();
  report["frames_in_sequence"] = info.sequence_frames;
  report["stopped_by"] = info.stopped_by;
  report["frames_with_pose"] = count([](const FrameRecord& r) { return r.has_pose(); });
  report["frames_skipped"] =
      count([](const FrameRecord& r) { return r.state == FrameState::kSkipped; });
  report["frames_inertial"] =
      count([](const FrameRecord& r) { return r.state == FrameState::kInertial; });
  report["frames_in_trajectory"] = FinalTrajectory(result, LargestComponent(result)).size();
  report["frames_that_needed_the_matcher"] =
      count([](const FrameRecord& r) { return r.used_matcher; });
  report["wall_seconds"] = info.wall_seconds;
  report["frames_per_second"] =
      info.wall_seconds > 0 ? static_cast<double>(records.size()) / info.wall_seconds : 0.0;
  report["keyframes"] = result.map.keyframes.size();
  report["landmarks"] = result.map.landmarks.size();
  report["lines"] = LineReport(result.map);
  report["components"] = components;
  report["inertial"] = InertialReport(result.inertial);
  report["lost_intervals"] = LostIntervals(records);
  report["stages"] = StageTable(times);
  report["frame_states"] = FrameStates(records);
  return report;
}

void WriteRunOutputs(const std::filesystem::path& folder, const PipelineResult& result,
                     const StageTimes& times, const RunInfo& info) {
  const int component = LargestComponent(result);
  WriteTum(folder / "trajectory.tum", FinalTrajectory(result, component));
  WriteTum(folder / "trajectory_online.tum", OnlineTrajectory(result, component));
  WriteTum(folder / "keyframes.tum", KeyframeTrajectory(result, component));
  const std::filesystem::path file = folder / "report.json";
  std::ofstream stream(file);
  stream << MakeReport(result, times, info).dump(1) << '\n';
  stream.close();
  if (!stream) Fail("cannot write {}", file.string());
}

}  // namespace airslam
