// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <nanobind/nanobind.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "airslam/common/log.h"
#include "airslam/common/options.h"
#include "airslam/dataset/sequence.h"
#include "airslam/odometry/live_odometry.h"
#include "airslam/odometry/map_run.h"
#include "src/arrays.h"
#include "src/bindings.h"
#include "src/config.h"
#include "src/frame_binding.h"
#include "src/images.h"
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

RunResult MakeResult(const PipelineResult& result, const RunInfo& info, MapRun& run) {
  const int component = LargestComponent(result);
  return {TrajectoryView(FinalTrajectory(result, component)),
          TrajectoryView(OnlineTrajectory(result, component)),
          TrajectoryView(KeyframeTrajectory(result, component)),
          std::make_shared<MapView>(result.map), MakeReport(result, run.times(), info).dump()};
}

// Makes the Frames of a run, one after the other.
class FrameMaker {
 public:
  explicit FrameMaker(MapRun& run) : run_(run) {}

  Frame operator()(const FrameObservation& seen) {
    Frame frame = MakeFrame(seen, run_.rectifier().body_from_left());
    std::map<std::string, double> now = run_.times().TotalsMs();
    for (const auto& [stage, total] : now) frame.stage_ms[stage] = total - before_[stage];
    before_ = std::move(now);
    return frame;
  }

 private:
  MapRun& run_;
  std::map<std::string, double> before_;  // totals of the stages
};

// Stops the run when Python has received a signal (Ctrl-C), and shows the frame to `on_frame`.
FrameObserver ObserverFor(const nb::object& on_frame, MapRun& run) {
  return [&on_frame, make = FrameMaker(run)](const FrameObservation& seen) mutable {
    const nb::gil_scoped_acquire acquire;
    if (PyErr_CheckSignals() != 0) throw nb::python_error();
    if (!on_frame.is_none()) on_frame(make(seen));
  };
}

MapRunRequest Request(const std::string& dataset, const fs::path& out, const Config& config,
                      const fs::path& model, bool imu, bool lines) {
  MapRunRequest request{dataset, out, {}, model.string()};
  config.Load(request.options);
  if (!imu) request.options.inertial.enabled = false;
  if (!lines) request.options.lines.enabled = false;
  return request;
}

RunResult Run(const fs::path& dataset, const fs::path& out, const Config& config,
              const fs::path& model, bool imu, bool lines, const nb::object& on_frame) {
  nb::gil_scoped_release release;
  const MapRunRequest request = Request(dataset.string(), out, config, model, imu, lines);
  const std::unique_ptr<Sequence> sequence = OpenSequence(dataset);
  for (const std::string& warning : sequence->warnings()) LogWarn("{}", warning);
  MapRun run(sequence->rig(), request);
  const PipelineResult result =
      RunPipeline(*sequence, run.rectifier(), run.options(), run.networks(), run.recorder(),
                  ObserverFor(on_frame, run), run.times());
  return MakeResult(result, run.Commit(result, sequence->size()), run);
}

using GivenVector = nb::ndarray<const double, nb::shape<3>, nb::c_contig, nb::device::cpu>;

// The running odometry, with the frames that are done but not yet told.
class PythonOdometry {
 public:
  PythonOdometry(const StereoRig& rig, const std::optional<fs::path>& out, const Config& config,
                 const fs::path& model, bool imu, bool lines)
      : live_(rig, Request("live", out.value_or(fs::path()), config, model, imu, lines),
              [this](const FrameObservation& seen) {
                Frame frame = (*make_)(seen);
                const std::lock_guard lock(mutex_);
                done_.push_back(std::move(frame));
              }) {
    make_.emplace(live_.run());
  }

  void AddImu(std::int64_t timestamp_ns, const GivenVector& gyroscope,
              const GivenVector& accelerometer) {
    ImuSample sample;
    sample.timestamp_ns = timestamp_ns;
    sample.angular_velocity = Eigen::Map<const Eigen::Vector3d>(gyroscope.data());
    sample.acceleration = Eigen::Map<const Eigen::Vector3d>(accelerometer.data());
    nb::gil_scoped_release release;
    live_.AddImu(sample);
  }

  std::vector<Frame> AddFrame(std::int64_t timestamp_ns, const GivenImage& left,
                              const GivenImage& right) {
    const StereoPair pair{timestamp_ns, AsMat(left), AsMat(right)};
    nb::gil_scoped_release release;
    live_.AddFrame(pair);
    return TakeDone();
  }

  std::vector<Frame> TakeDone() {
    const std::lock_guard lock(mutex_);
    return std::exchange(done_, {});
  }

  void EndImu() { live_.EndImu(); }

  RunResult Finish() {
    nb::gil_scoped_release release;
    const LiveOdometry::Outcome outcome = live_.Finish();
    return MakeResult(outcome.result, outcome.info, live_.run());
  }

 private:
  std::mutex mutex_;
  std::vector<Frame> done_;
  std::optional<FrameMaker> make_;  // before the first frame comes
  LiveOdometry live_;               // last: its thread uses the others
};

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
      "run", &Run, "dataset"_a, "out"_a, nb::kw_only(), "config"_a.none() = nb::none(),
      "model"_a = kDefaultModelPack, "imu"_a = true, "lines"_a = true, "on_frame"_a = nb::none(),
      nb::sig(
          "def run(dataset: str | os.PathLike, out: str | os.PathLike, *, config: str | "
          "os.PathLike | dict | None = None, model: str | os.PathLike = 'airslam-fast', imu: "
          "bool = True, lines: bool = True, on_frame: collections.abc.Callable[[Frame], object] "
          "| None = None) -> RunResult"),
      "Makes trajectories and a map of a recorded sequence, as `airslam map` does, bit for bit.\n\n"
      "dataset: EuRoC ASL or KITTI odometry folder. out: folder of results; an earlier one is "
      "replaced when the run has ended. config: options, a YAML file or a dict of the same names "
      "(docs/options.md). model: model pack, a name or a folder. on_frame: called with a Frame "
      "after each frame, from the calling thread; what it "
      "raises ends the run. Raises Error.");
  nb::class_<PythonOdometry>(
      module, "Odometry",
      "Odometry of a rig that is running. Add readings of the IMU and frames as they come, from "
      "one "
      "thread; the result is that of airslam.run on the same data recorded, bit for bit. A frame "
      "is "
      "worked on when the readings up to its time have come (and, while the IMU is being "
      "initialised, 65 ms further).")
      .def(nb::init<const StereoRig&, const std::optional<fs::path>&, const Config&,
                    const fs::path&, bool, bool>(),
           "rig"_a, nb::kw_only(), "out"_a = nb::none(), "config"_a.none() = nb::none(),
           "model"_a = kDefaultModelPack, "imu"_a = true, "lines"_a = true,
           nb::call_guard<nb::gil_scoped_release>(),
           "out: folder of results as of airslam.run, or None: results in memory alone. The other "
           "arguments are those of airslam.run. Raises Error.")
      .def(
          "add_imu", &PythonOdometry::AddImu, "timestamp_ns"_a, "gyroscope"_a, "accelerometer"_a,
          "A reading: rad/s and m/s^2 (specific force), three float64 each, in the IMU's own time. "
          "Raises Error, taking nothing in, when it is not finite or not after the last one.")
      .def("add_frame", &PythonOdometry::AddFrame, "timestamp_ns"_a, "left"_a.noconvert(),
           "right"_a.noconvert(),
           "A raw pair, uint8 height x width, which is copied. Waits while two frames wait to be "
           "read. Returns the frames that are done since the last call. Raises Error, taking "
           "nothing "
           "in, for images of another size, a time not after the last one's, or when 100 frames "
           "wait "
           "for readings of the IMU; and raises what ended the run, if something has.")
      .def("take_done", &PythonOdometry::TakeDone, "The frames that are done since the last call.")
      .def("end_imu", &PythonOdometry::EndImu,
           "No reading will come any more: the frames go on without.")
      .def("finish", &PythonOdometry::Finish,
           "Waits for the frames under way (take_done has them) and writes the results. Once only. "
           "An Odometry that goes away without it leaves no result but <out>.partial/map.db.");
}

}  // namespace airslam::python
