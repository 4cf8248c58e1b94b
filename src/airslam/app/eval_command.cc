// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <cmath>
#include <cstdio>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "airslam/app/commands.h"
#include "airslam/common/error.h"
#include "airslam/dataset/sequence.h"
#include "airslam/dataset/trajectory.h"
#include "airslam/evaluate/error_json.h"
#include "airslam/evaluate/trajectory_error.h"

namespace airslam {
namespace {

struct EvalArguments {
  std::string groundtruth;
  std::string estimate;
  std::string dataset;
  std::string json;
  bool sim3 = false;
  bool no_align = false;
  EvaluationOptions options;
};

double Degrees(double radians) { return radians * 180 / std::acos(-1.0); }

std::vector<std::int64_t> FrameTimes(const std::string& dataset) {
  std::vector<std::int64_t> times;
  if (dataset.empty()) return times;
  const std::unique_ptr<Sequence> sequence = OpenSequence(dataset);
  for (int i = 0; i < sequence->size(); ++i) times.push_back(sequence->timestamp_ns(i));
  return times;
}

void PrintStatistics(const std::string& name, const ErrorStatistics& s, const std::string& unit,
                     double factor) {
  fmt::print("{:<22} rmse {:.4f}   mean {:.4f}   median {:.4f}   max {:.4f}   {} ({} values)\n",
             name, factor * s.rmse, factor * s.mean, factor * s.median, factor * s.max, unit,
             s.count);
}

void Print(const TrajectoryErrors& errors) {
  const int delta = errors.options.rpe_delta;
  fmt::print("alignment              {}", ToString(errors.options.alignment));
  if (errors.options.alignment == TrajectoryAlignment::kSim3) {
    fmt::print(", scale {:.6f}", errors.groundtruth_from_estimate.scale);
  }
  fmt::print(
      "\ncompared               {} poses (estimate {}, ground truth {}), {:.1f} s, {:.2f} m\n",
      errors.compared_poses, errors.estimated_poses, errors.groundtruth_poses, errors.duration,
      errors.path_length);
  fmt::print("coverage               {:.1f} % of {} {}\n", 100 * errors.coverage,
             errors.coverage_frames, errors.coverage_basis);
  PrintStatistics("ATE position", errors.position, "m", 1);
  if (errors.relative_translation.count == 0) {
    fmt::print("RPE                    too few poses for a delta of {} frames\n", delta);
    return;
  }
  PrintStatistics(fmt::format("RPE translation / {}", delta), errors.relative_translation, "m", 1);
  PrintStatistics(fmt::format("RPE rotation / {}", delta), errors.relative_rotation, "deg",
                  Degrees(1));
}

void WriteJson(const EvalArguments& arguments, const TrajectoryErrors& errors) {
  nlohmann::json json = ToJson(errors);
  json["groundtruth"] = arguments.groundtruth;
  json["estimate"] = arguments.estimate;
  std::ofstream stream(arguments.json);
  stream << json.dump(2) << '\n';
  stream.close();
  if (!stream) Fail("the result cannot be written to {}", arguments.json);
}

void RunEval(const EvalArguments& arguments) {
  EvaluationOptions options = arguments.options;
  if (arguments.sim3) options.alignment = TrajectoryAlignment::kSim3;
  if (arguments.no_align) options.alignment = TrajectoryAlignment::kNone;
  const TrajectoryErrors errors =
      EvaluateTrajectory(ReadTrajectory(arguments.groundtruth), ReadTrajectory(arguments.estimate),
                         options, FrameTimes(arguments.dataset));
  Print(errors);
  if (!arguments.json.empty()) WriteJson(arguments, errors);
}

}  // namespace

void AddEvalCommand(CLI::App& app) {
  auto arguments = std::make_shared<EvalArguments>();
  CLI::App* command = app.add_subcommand("eval", "Compare a trajectory with its ground truth");
  command->add_option("groundtruth", arguments->groundtruth, "TUM, EuRoC csv or KITTI poses")
      ->required();
  command->add_option("estimate", arguments->estimate, "TUM, EuRoC csv or KITTI poses")->required();
  CLI::Option* sim3 =
      command->add_flag("--sim3", arguments->sim3, "Align with a scale too (the default is SE(3))");
  command->add_flag("--no-align", arguments->no_align, "Compare positions as they are")
      ->excludes(sim3);
  command->add_option("--delta", arguments->options.rpe_delta, "Frames between relative poses")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command
      ->add_option("--max-time-difference", arguments->options.max_time_difference,
                   "Seconds between poses that are compared")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  command->add_option("--dataset", arguments->dataset,
                      "The sequence's folder: the coverage then counts its frames");
  command->add_option("--json", arguments->json, "Also write the result to this file");
  command->callback([arguments] { RunEval(*arguments); });
}

}  // namespace airslam
