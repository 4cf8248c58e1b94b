// SPDX-License-Identifier: BSD-3-Clause
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>

#include "airslam/app/commands.h"
#include "airslam/common/error.h"
#include "airslam/common/log.h"
#include "airslam/map/colmap_export.h"
#include "airslam/map/keyframe_trajectory.h"
#include "airslam/map/map_file.h"
#include "airslam/map/ply_export.h"

namespace airslam {
namespace {

struct ExportArguments {
  std::string map, tum, ply, colmap;
  int component = -1;  // -1: the largest
};

// The component that was asked for, or the largest one.
int ChooseComponent(const Map& map, const ExportArguments& arguments) {
  const int largest = LargestMapComponent(map);
  if (largest < 0) Fail("map {} holds no keyframe", arguments.map);
  const int chosen = arguments.component >= 0 ? arguments.component : largest;
  std::size_t others = 0;
  for (const auto& [id, keyframe] : map.keyframes) others += keyframe.component != chosen;
  if (others == map.keyframes.size()) Fail("map {} has no component {}", arguments.map, chosen);
  if (others > 0 && arguments.component < 0) {
    LogWarn("component {} is exported; {} keyframes of other components are not", chosen, others);
  }
  return chosen;
}

void RunExport(const ExportArguments& arguments) {
  if (arguments.tum.empty() && arguments.ply.empty() && arguments.colmap.empty()) {
    Fail("name what to write: --tum, --ply or --colmap");
  }
  const Map map = ReadMap(MapFilePath(arguments.map));
  const int component = ChooseComponent(map, arguments);
  if (!arguments.tum.empty()) {
    WriteTum(arguments.tum, MapTrajectory(map, component));
    std::printf("keyframes in %s\n", arguments.tum.c_str());
  }
  if (!arguments.ply.empty()) {
    WritePly(map, component, arguments.ply);
    std::printf("points in %s\n", arguments.ply.c_str());
  }
  if (!arguments.colmap.empty()) {
    WriteColmap(map, component, arguments.colmap);
    std::printf("COLMAP model in %s\n", arguments.colmap.c_str());
  }
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
