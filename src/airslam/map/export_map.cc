// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/map/export_map.h"

#include <cstddef>

#include "airslam/common/error.h"
#include "airslam/common/log.h"
#include "airslam/map/colmap_export.h"
#include "airslam/map/keyframe_trajectory.h"
#include "airslam/map/map_file.h"
#include "airslam/map/ply_export.h"

namespace airslam {
namespace {

// The component that is asked for, or the largest one.
int ChooseComponent(const Map& map, const ExportRequest& request) {
  const int largest = LargestMapComponent(map);
  if (largest < 0) Fail("map {} holds no keyframe", request.map.string());
  const int chosen = request.component.value_or(largest);
  std::size_t others = 0;
  for (const auto& [id, keyframe] : map.keyframes) others += keyframe.component != chosen;
  if (others == map.keyframes.size()) {
    Fail("map {} has no component {}", request.map.string(), chosen);
  }
  if (others > 0 && !request.component) {
    LogWarn("component {} is exported; {} keyframes of other components are not", chosen, others);
  }
  return chosen;
}

}  // namespace

int ExportMap(const ExportRequest& request) {
  if (request.tum.empty() && request.ply.empty() && request.colmap.empty()) {
    Fail("an export must name what to write: tum, ply or colmap");
  }
  const Map map = ReadMap(MapFilePath(request.map));
  const int component = ChooseComponent(map, request);
  if (!request.tum.empty()) WriteTum(request.tum, MapTrajectory(map, component));
  if (!request.ply.empty()) WritePly(map, component, request.ply);
  if (!request.colmap.empty()) WriteColmap(map, component, request.colmap);
  return component;
}

}  // namespace airslam
