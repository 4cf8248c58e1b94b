// SPDX-License-Identifier: BSD-3-Clause
#include <cstdio>
#include <memory>
#include <string>

#include "airslam/app/commands.h"
#include "airslam/common/log.h"
#include "airslam/common/options.h"
#include "airslam/common/progress.h"
#include "airslam/common/stop_signal.h"
#include "airslam/odometry/map_run.h"
#include "airslam/odometry/pipeline.h"
#include "airslam/odometry/report.h"

namespace airslam {
namespace {

struct MapArguments {
  std::string dataset;
  std::string out;
  std::string config;
  std::string model = kDefaultModelPack;
  bool no_imu = false;
  bool no_lines = false;
};

// Reports progress and says when tracking is lost and found again.
class Narrator {
 public:
  explicit Narrator(int frames) : progress_("map", frames) {}

  void Frame(int index, const FrameRecord& record) {
    const bool lost = record.state == FrameState::kLost;
    if (lost && !was_lost_) LogWarn("frame {}: tracking lost", index);
    if (!lost && was_lost_) {
      LogWarn("frame {}: {}", index,
              record.state == FrameState::kInitialized ? "a new component starts"
                                                       : "tracking recovered");
    }
    const bool inertial = record.state == FrameState::kInertial;
    if (inertial && !was_inertial_) LogWarn("frame {}: vision lost, the IMU carries on", index);
    if (!inertial && !lost && was_inertial_) LogWarn("frame {}: vision is back", index);
    was_lost_ = lost;
    was_inertial_ = inertial;
    state_ = lost       ? "lost"
             : inertial ? "IMU alone"
                        : fmt::format("{} points", record.tracked_points);
    done_ = index + 1;
    progress_.Update(done_, state_);
  }

  void Finish() { progress_.Finish(done_, state_); }

 private:
  Progress progress_;
  int done_ = 0;
  std::string state_;
  bool was_lost_ = false;
  bool was_inertial_ = false;
};

void PrintSummary(const PipelineResult& result, const RunInfo& info, const std::string& out) {
  const int component = LargestComponent(result);
  if (component < 0) LogWarn("no frame could be tracked: the trajectory is empty");
  const std::size_t posed = FinalTrajectory(result, component).size();
  const Map& map = result.map;
  std::printf("%zu of %zu frames in the trajectory, %zu keyframes, %zu landmarks, %zu lines\n",
              posed, result.records.size(), map.keyframes.size(), map.landmarks.size(),
              map.line_landmarks.size());
  std::printf("%.1f s, %.1f frames/s; results in %s\n", info.wall_seconds,
              static_cast<double>(result.records.size()) / info.wall_seconds, out.c_str());
}

// Says how far a run came that was asked to stop.
[[noreturn]] void ReportStop(const StopSignal& stop, std::size_t frames, int sequence_frames,
                             const std::string& out) {
  const std::string results = frames == 0 ? "nothing was written" : "results up to there in " + out;
  throw Stopped(stop.number(), fmt::format("stopped by {} after {} of {} frames: {}", stop.name(),
                                           frames, sequence_frames, results));
}

void RunMap(const MapArguments& arguments) {
  MapRunRequest request{arguments.dataset, arguments.out, {}, arguments.model};
  OdometryOptions& options = request.options;
  if (!arguments.config.empty()) LoadOptions(arguments.config, options);
  if (arguments.no_imu) options.inertial.enabled = false;
  if (arguments.no_lines) options.lines.enabled = false;
  const std::unique_ptr<Sequence> sequence = OpenSequence(arguments.dataset);
  for (const std::string& warning : sequence->warnings()) LogWarn("{}", warning);

  const StopSignal stop;
  MapRun run(sequence->rig(), request);
  Narrator narrator(sequence->size());
  const PipelineResult result = RunPipeline(
      *sequence, run.rectifier(), options, run.networks(), run.recorder(),
      [&](const FrameObservation& seen) { narrator.Frame(seen.prepared.index, seen.record); },
      run.times(), &stop.flag());
  narrator.Finish();

  const bool stopped = static_cast<int>(result.records.size()) < sequence->size();
  if (stopped && result.records.empty()) ReportStop(stop, 0, sequence->size(), arguments.out);
  const RunInfo info = run.Commit(result, sequence->size(), stopped ? stop.name() : "");
  PrintSummary(result, info, arguments.out);
  if (stopped) ReportStop(stop, result.records.size(), sequence->size(), arguments.out);
}

}  // namespace

void AddMapCommand(CLI::App& app) {
  auto arguments = std::make_shared<MapArguments>();
  CLI::App* command =
      app.add_subcommand("map", "Stereo(-inertial) odometry: a sequence to a trajectory and a map");
  command->add_option("dataset", arguments->dataset, "EuRoC (holds mav0) or KITTI odometry folder")
      ->required();
  command->add_option("--out", arguments->out, "Folder of results; an earlier one is replaced")
      ->required();
  command->add_option("--config", arguments->config, "YAML file of options");
  command->add_option("--model", arguments->model, "Model pack: a name or a folder");
  command->add_flag("--no-imu", arguments->no_imu, "Leave the IMU out: stereo alone");
  command->add_flag("--no-lines", arguments->no_lines, "Leave lines out: points alone");
  command->callback([arguments] { RunMap(*arguments); });
}

}  // namespace airslam
