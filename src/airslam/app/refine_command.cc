// SPDX-License-Identifier: BSD-3-Clause
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "airslam/app/commands.h"
#include "airslam/common/options.h"
#include "airslam/common/progress.h"
#include "airslam/refine/refine_map_files.h"

namespace airslam {
namespace {

struct RefineArguments {
  std::string map;                // of refine
  std::vector<std::string> maps;  // of merge
  std::string out, config, model, report;
};

// A progress line for each map processor that says how far it is.
class ProgressLines {
 public:
  void operator()(const RefineProgress& progress) {
    if (!progress.ended) {
      if (!line_) line_.emplace(std::string(progress.processor), progress.total);
      line_->Update(progress.done, progress.state);
    } else if (line_) {
      line_->Finish(progress.done, progress.state);
      line_.reset();
    }
  }

 private:
  std::optional<Progress> line_;
};

void PrintSummary(const RefineResult& result, const std::string& out) {
  for (const nlohmann::json& step : result.report["steps"]) {
    std::printf("%-20s %7.2f s %8.0f MiB", step["name"].get<std::string>().c_str(),
                step["seconds"].get<double>(), step["memory_peak_mib"].get<double>());
    if (step.contains("skipped")) {
      std::printf("   skipped: %s", step["skipped"].get<std::string>().c_str());
    }
    std::printf("\n");
  }
  const nlohmann::json &before = result.report["before"], &after = result.report["after"];
  const auto line = [&](const char* state, const nlohmann::json& e) {
    std::printf("%-6s %d keyframes, %d components, %d landmarks, re-projection %.2f px\n", state,
                e["keyframes"].get<int>(), e["components"].get<int>(), e["landmarks"].get<int>(),
                e["reprojection_rms_px"].get<double>());
  };
  line("before", before);
  line("after", after);
  std::printf("%zu loops; the refined map is %s\n", result.loops.size(), out.c_str());
}

void RunRefine(const RefineArguments& arguments) {
  RefineRequest request;
  request.maps.assign(arguments.maps.begin(), arguments.maps.end());
  if (!arguments.map.empty()) request.maps = {arguments.map};
  request.out = arguments.out;
  if (!arguments.config.empty()) LoadOptions(arguments.config, request.options);
  request.model_pack = arguments.model;
  request.report = arguments.report;
  PrintSummary(RefineMapFiles(request, ProgressLines()), arguments.out);
}

void AddCommonOptions(CLI::App& command, RefineArguments& arguments) {
  command.add_option("--out", arguments.out, "The map file to write; an earlier one is replaced")
      ->required();
  command.add_option("--config", arguments.config, "YAML file of options");
  command.add_option("--model", arguments.model,
                     "Model pack, if it is not where the map's is looked for");
  command.add_option("--report", arguments.report,
                     "JSON file of what was done; a picture of the loops is put beside it");
}

}  // namespace

void AddRefineCommand(CLI::App& app) {
  const auto arguments = std::make_shared<RefineArguments>();
  CLI::App* command = app.add_subcommand(
      "refine", "Optimize a map: loops, merging, pose graph, bundle adjustment, place words");
  command->add_option("map", arguments->map, "The map file, e.g. out/map.db")->required();
  AddCommonOptions(*command, *arguments);
  command->callback([arguments] { RunRefine(*arguments); });
}

void AddMergeCommand(CLI::App& app) {
  const auto arguments = std::make_shared<RefineArguments>();
  CLI::App* command =
      app.add_subcommand("merge", "Join further sessions into a map, and refine the whole");
  command->add_option("maps", arguments->maps, "The map whose world stays, then the others")
      ->required()
      ->expected(2, CLI::detail::expected_max_vector_size);
  AddCommonOptions(*command, *arguments);
  command->callback([arguments] { RunRefine(*arguments); });
}

}  // namespace airslam
