// SPDX-License-Identifier: BSD-3-Clause
#include <cstdio>
#include <memory>
#include <string>

#include "airslam/app/commands.h"
#include "airslam/map/map_file.h"
#include "airslam/map/map_summary.h"

namespace airslam {

void AddInfoCommand(CLI::App& app) {
  struct Arguments {
    std::string file;
    bool json = false;
  };
  const auto arguments = std::make_shared<Arguments>();
  CLI::App* command = app.add_subcommand("info", "Print what a map file holds");
  command->add_option("map", arguments->file, "The map file, e.g. out/map.db")->required();
  command->add_flag("--json", arguments->json, "Print JSON");
  command->callback([arguments] {
    const MapSummary summary = SummarizeMap(MapFilePath(arguments->file));
    const std::string text =
        arguments->json ? MapSummaryToJson(summary).dump(2) + '\n' : FormatMapSummary(summary);
    std::fputs(text.c_str(), stdout);
  });
}

}  // namespace airslam
