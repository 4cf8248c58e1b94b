// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <nanobind/nanobind.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>

#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "airslam/common/log.h"
#include "airslam/common/options.h"
#include "airslam/dataset/sequence.h"
#include "airslam/odometry/map_run.h"
#include "src/arrays.h"
#include "src/bindings.h"
#include "src/frame_binding.h"
#include "src/json.h"
#include "src/map_binding.h"
#include "src/trajectory_binding.h"

namespace airslam::python {
namespace {

namespace fs = std::filesystem;
using nb::literals::operator""_a;

// What a run leaves.
struct RunResult {
  TrajectoryView trajectory, online_trajectory, keyframe_trajectory;
  std::shared_ptr<MapView> map;
  std::string report;
};

RunResult MakeResult(const PipelineResult& result, MapRun& run, int sequence_frames) {
  const RunInfo info = run.Commit(result, sequence_frames);
  const int component = LargestComponent(result);
  return {TrajectoryView(FinalTrajectory(result, component)),
          TrajectoryView(OnlineTrajectory(result, component)),
          TrajectoryView(KeyframeTrajectory(result, component)),
          std::make_shared<MapView>(result.map), MakeReport(result, run.times(), info).dump()};
}

// Stops the run when Python has received a signal (Ctrl-C), and shows the frame to `on_frame`.
FrameObserver ObserverFor(const nb::object& on_frame, const Rigid3& body_from_cam,
                          const StageTimes& times) {
  return [&on_frame, body_from_cam, &times, before = std::map<std::string, double>()](
             int, const PreparedFrame& prepared, const FrameRecord& record) mutable {
    const nb::gil_scoped_acquire acquire;
    if (PyErr_CheckSignals() != 0) throw nb::python_error();
    if (on_frame.is_none()) return;
    Frame frame = MakeFrame(prepared, record, body_from_cam);
    std::map<std::string, double> now = times.TotalsMs();
    for (const auto& [stage, total] : now) frame.stage_ms[stage] = total - before[stage];
    before = std::move(now);
    on_frame(std::move(frame));
  };
}

RunResult Run(const fs::path& dataset, const fs::path& out, const std::optional<fs::path>& config,
              const std::string& model, bool imu, bool lines, const nb::object& on_frame) {
  nb::gil_scoped_release release;
  MapRunRequest request{dataset.string(), out, {}, model};
  if (config) LoadOptions(*config, request.options);
  if (!imu) request.options.inertial.enabled = false;
  if (!lines) request.options.lines.enabled = false;
  const std::unique_ptr<Sequence> sequence = OpenSequence(dataset);
  for (const std::string& warning : sequence->warnings()) LogWarn("{}", warning);
  MapRun run(sequence->rig(), request);
  const PipelineResult result = RunPipeline(
      *sequence, run.rectifier(), run.options(), run.networks(), run.recorder(),
      ObserverFor(on_frame, run.rectifier().body_from_left(), run.times()), run.times());
  return MakeResult(result, run, sequence->size());
}

}  // namespace

void BindOdometry(nb::module_& module) {
  nb::class_<RunResult>(module, "RunResult", "What a run leaves.")
      .def_ro("trajectory", &RunResult::trajectory,
              "Final poses of the largest component, as in trajectory.tum.")
      .def_ro("online_trajectory", &RunResult::online_trajectory,
              "The same as first estimated, frame by frame.")
      .def_ro("keyframe_trajectory", &RunResult::keyframe_trajectory, "Of the keyframes.")
      .def_ro("map", &RunResult::map, "The map, as in map.db but with exact descriptors.")
      .def_prop_ro(
          "report", [](const RunResult& r) { return ToPython(r.report); },
          nb::sig("def report(self) -> dict"), "What report.json holds (docs/outputs.md).",
          nb::rv_policy::automatic);
  module.def(
      "run", &Run, "dataset"_a, "out"_a, nb::kw_only(), "config"_a = nb::none(),
      "model"_a = kDefaultModelPack, "imu"_a = true, "lines"_a = true, "on_frame"_a = nb::none(),
      nb::sig("def run(dataset: str | os.PathLike, out: str | os.PathLike, *, config: str | "
              "os.PathLike "
              "| None = None, model: str = 'airslam-fast', imu: bool = True, lines: bool = True, "
              "on_frame: collections.abc.Callable[[Frame], object] | None = None) -> RunResult"),
      "Makes trajectories and a map of a recorded sequence, as `airslam map` does, bit for bit.\n\n"
      "dataset: EuRoC ASL or KITTI odometry folder. out: folder of results; an earlier one is "
      "replaced when the run has ended. config: YAML file of options. model: model pack, a name or "
      "a "
      "folder. on_frame: called with a Frame after each frame, from the calling thread; what it "
      "raises ends the run. Raises Error.");
}

}  // namespace airslam::python
