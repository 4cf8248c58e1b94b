// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/map/write_map.h"

#include <map>
#include <vector>

#include "airslam/common/atomic_file.h"
#include "airslam/map/map_file.h"

namespace airslam {

void WriteMap(const Map& map, const std::optional<PlaceRecord>& place,
              const std::filesystem::path& file) {
  // A landmark is written with the keyframe that it belongs to.
  std::map<KeyframeId, std::vector<Landmark>> points;
  std::map<KeyframeId, std::vector<LineLandmark>> lines;
  for (const auto& [id, landmark] : map.landmarks)
    points[landmark.first_seen_by].push_back(landmark);
  for (const auto& [id, line] : map.line_landmarks) lines[line.first_seen_by].push_back(line);
  AtomicFile atomic(file);
  MapWriter writer(atomic.partial(), map.calibration, map.model_pack, map.model_pack_sha256);
  for (const auto& [id, keyframe] : map.keyframes) {
    writer.AddKeyframe(keyframe, points[id], lines[id]);
  }
  if (place) writer.WritePlaceRecord(*place);
  writer.Close();
  atomic.Commit();
}

}  // namespace airslam
