// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/refine/refine.h"

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>
#include <string>

#include "airslam/app/commands.h"
#include "airslam/app/picture.h"
#include "airslam/common/atomic_file.h"
#include "airslam/common/error.h"
#include "airslam/common/log.h"
#include "airslam/common/options.h"
#include "airslam/map/map_file.h"
#include "airslam/map/write_map.h"
#include "airslam/neural/transformer_matcher.h"
#include "airslam/place/place_index.h"
#include "airslam/refine/join_maps.h"
#include "airslam/refine/loop_picture.h"

namespace airslam {
namespace fs = std::filesystem;
namespace {

struct RefineArguments {
  std::string map, second, out, config, model, report;
};

// The networks that find loops: those that made the map.
struct Networks {
  std::unique_ptr<FeatureMatcher> matcher;
  std::shared_ptr<const Vocabulary> vocabulary;
};

Networks LoadNetworks(const Map& map, const RefineArguments& arguments) {
  const ModelPack pack = LoadModelPack(arguments.model.empty() ? map.model_pack : arguments.model);
  if (pack.features.network.sha256 != map.model_pack_sha256) {
    Fail("map {} was made with other weights than those of model pack {}", arguments.map,
         pack.name);
  }
  Networks networks;
  if (pack.matcher) {
    networks.matcher =
        std::make_unique<TransformerMatcher>(*pack.matcher, pack.features.descriptor_size);
  }
  if (pack.vocabulary) networks.vocabulary = LoadVocabulary(pack);
  return networks;
}

// A map that is its own output would be lost if anything went wrong with it.
void RequireOtherFile(const fs::path& input, const fs::path& output) {
  std::error_code error;
  if (fs::equivalent(input, output, error)) {
    Fail("--out is the input {}, which is never changed", input.string());
  }
}

void WriteReport(const RefineArguments& arguments, const RefineResult& result, const Map& map,
                 const std::map<KeyframeId, Rigid3>& before) {
  fs::path picture = arguments.report;
  picture.replace_extension(".png");
  WritePicture(picture.string(), DrawLoops(map, before, result.loops));
  nlohmann::json report = result.report;
  report["map"] = arguments.map;
  if (!arguments.second.empty()) report["second_map"] = arguments.second;
  report["out"] = arguments.out;
  report["picture"] = picture.string();
  AtomicFile file(arguments.report);
  std::ofstream stream(file.partial());
  stream << report.dump(2) << '\n';
  stream.close();
  if (!stream) Fail("the report cannot be written to {}", arguments.report);
  file.Commit();
}

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

void RequireJoined(const Map& map, KeyframeId first_of_second, const RefineArguments& arguments) {
  for (const auto& [id, keyframe] : map.keyframes) {
    if (id >= first_of_second && keyframe.component == map.keyframes.begin()->second.component) {
      return;
    }
  }
  Fail("no place of {} was found again in {}: the sessions cannot be joined", arguments.second,
       arguments.map);
}

void RunRefine(const RefineArguments& arguments) {
  RefineOptions options;
  if (!arguments.config.empty()) LoadOptions(arguments.config, options);
  options.Validate();
  const fs::path input = MapFilePath(arguments.map);
  RequireOtherFile(input, arguments.out);
  const AtomicFile place(arguments.out);  // says now, not after the work, that it cannot be written
  Map map = ReadMap(input);
  if (map.keyframes.empty()) Fail("map {} holds no keyframe", arguments.map);
  const KeyframeId first_of_second = map.keyframes.rbegin()->first + 1;
  if (!arguments.second.empty()) {
    const fs::path second = MapFilePath(arguments.second);
    RequireOtherFile(second, arguments.out);
    AppendMap(ReadMap(second), map, arguments.map, arguments.second);
  }
  const Networks networks = LoadNetworks(map, arguments);
  std::map<KeyframeId, Rigid3> before;
  for (const auto& [id, keyframe] : map.keyframes) before[id] = keyframe.world_from_cam;
  const RefineResult result =
      RefineMap(options, {networks.matcher.get(), networks.vocabulary}, map);
  if (!arguments.second.empty()) RequireJoined(map, first_of_second, arguments);
  WriteMap(map, result.place, arguments.out);
  if (!arguments.report.empty()) WriteReport(arguments, result, map, before);
  PrintSummary(result, arguments.out);
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
      app.add_subcommand("merge", "Join a second session into a map, and refine the whole");
  command->add_option("first", arguments->map, "The map whose world stays")->required();
  command->add_option("second", arguments->second, "The map of the second session")->required();
  AddCommonOptions(*command, *arguments);
  command->callback([arguments] { RunRefine(*arguments); });
}

}  // namespace airslam
