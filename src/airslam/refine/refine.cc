// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/refine/refine.h"

#include <chrono>
#include <cmath>
#include <fstream>

#include "airslam/refine/map_tools.h"

namespace airslam {
namespace {

// A value in MiB of /proc/self/status: "VmRSS:" is the resident memory, "VmHWM:" its peak so far.
double MemoryMib(const std::string& key) {
  std::ifstream stream("/proc/self/status");
  for (std::string word; stream >> word;) {
    double kib = 0;
    if (word == key && stream >> kib) return kib / 1024;
  }
  return 0;
}

// Forgets the peak, so that the next one is that of the next step alone (Linux 4.0 on).
void ResetMemoryPeak() { std::ofstream("/proc/self/clear_refs") << "5"; }

// How far loops are from what the keyframes' poses say.
nlohmann::json LoopErrors(const Map& map, const std::vector<Loop>& loops) {
  double squares = 0, turns = 0;
  int count = 0;
  for (const Loop& loop : loops) {
    if (!map.keyframes.contains(loop.earlier) || !map.keyframes.contains(loop.later)) continue;
    const Rigid3 error = loop.earlier_from_later.Inverse() *
                         map.keyframes.at(loop.earlier).world_from_cam.Inverse() *
                         map.keyframes.at(loop.later).world_from_cam;
    squares += error.translation.squaredNorm();
    turns += error.Angle() * error.Angle();
    ++count;
  }
  const double n = std::max(count, 1);
  return {{"loops", count},
          {"rms_position_m", std::sqrt(squares / n)},
          {"rms_rotation_rad", std::sqrt(turns / n)}};
}

nlohmann::json DescribeErrors(const Map& map, const std::vector<Loop>& loops) {
  const MapErrors errors = MeasureErrors(map);
  return {{"keyframes", errors.keyframes},
          {"components", errors.components},
          {"landmarks", errors.landmarks},
          {"observations", errors.observations},
          {"line_landmarks", map.line_landmarks.size()},
          {"reprojection_median_px", errors.median_error},
          {"reprojection_rms_px", errors.rms_error},
          {"loop_errors", LoopErrors(map, loops)}};
}

// Runs one processor; what it reports, with its time and memory and the errors after it.
nlohmann::json RunStep(const std::string& name, Map& map, RefineContext& context,
                       const RefineObserver& observer) {
  ResetMemoryPeak();
  context.report = nlohmann::json::object();
  RefineProgress last{name};
  std::string state;
  context.progress = [&](int done, int total, std::string_view word) {
    state = word;
    last = {name, done, total, state};
    if (observer) observer(last);
  };
  const auto start = std::chrono::steady_clock::now();
  MakeMapProcessor(name)->Process(map, context);
  const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start;
  last.ended = true;
  if (observer) observer(last);
  nlohmann::json step = context.report;
  step["name"] = name;
  step["seconds"] = seconds.count();
  step["memory_peak_mib"] = MemoryMib("VmHWM:");
  step["after"] = DescribeErrors(map, context.loops);
  return step;
}

}  // namespace

std::vector<OdometryEdge> CollectOdometry(const Map& map) {
  std::vector<OdometryEdge> edges;
  std::map<int, const Keyframe*> latest;  // of each component
  for (const auto& [id, keyframe] : map.keyframes) {
    const Keyframe*& previous = latest[keyframe.component];
    if (previous != nullptr) {
      edges.push_back(
          {previous->id, id, previous->world_from_cam.Inverse() * keyframe.world_from_cam});
    }
    previous = &keyframe;
  }
  return edges;
}

RefineResult RefineMap(const RefineOptions& options, const RefineParts& parts, Map& map,
                       const RefineObserver& observer) {
  options.Validate();
  RefineContext context{options, parts.matcher, parts.vocabulary};
  context.odometry = CollectOdometry(map);
  RefineResult result;
  const auto start = std::chrono::steady_clock::now();
  result.report["before"] = DescribeErrors(map, {});
  result.report["memory_before_mib"] = MemoryMib("VmRSS:");
  result.report["steps"] = nlohmann::json::array();
  double peak = 0;
  for (const std::string& name : options.ProcessorNames()) {
    result.report["steps"].push_back(RunStep(name, map, context, observer));
    peak = std::max(peak, result.report["steps"].back()["memory_peak_mib"].get<double>());
  }
  const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start;
  result.report["after"] = DescribeErrors(map, context.loops);
  result.report["seconds"] = seconds.count();
  result.report["memory_peak_mib"] = peak;
  result.loops = std::move(context.loops);
  result.place = std::move(context.place);
  return result;
}

}  // namespace airslam
