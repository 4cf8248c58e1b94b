// SPDX-License-Identifier: BSD-3-Clause
#include <cstdio>
#include <memory>
#include <optional>
#include <string>

#include "airslam/app/commands.h"
#include "airslam/map/export_map.h"

namespace airslam {
namespace {

struct ExportArguments {
  std::string map, tum, ply, colmap;
  std::optional<int> component;
};

void RunExport(const ExportArguments& arguments) {
  ExportMap({arguments.map, arguments.tum, arguments.ply, arguments.colmap, arguments.component});
  if (!arguments.tum.empty()) std::printf("keyframes in %s\n", arguments.tum.c_str());
  if (!arguments.ply.empty()) std::printf("points in %s\n", arguments.ply.c_str());
  if (!arguments.colmap.empty()) std::printf("COLMAP model in %s\n", arguments.colmap.c_str());
}

}  // namespace

void AddExportCommand(CLI::App& app) {
  const auto arguments = std::make_shared<ExportArguments>();
  CLI::App* command = app.add_subcommand("export", "Write a map in formats of other programs");
  command->add_option("map", arguments->map, "The map file, e.g. out/map.db")->required();
  command->add_option("--tum", arguments->tum,
                      "Poses of keyframes (world from body) as a TUM file");
  command->add_option("--ply", arguments->ply, "Points, lines and path as a PLY file");
  command->add_option("--colmap", arguments->colmap, "Folder for a COLMAP model in text form");
  command
      ->add_option("--component", arguments->component,
                   "Which component, where tracking was lost; the largest if not given")
      ->check(CLI::NonNegativeNumber);
  command->callback([arguments] { RunExport(*arguments); });
}

}  // namespace airslam
