// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/refine/join_maps.h"

#include <cmath>

#include "airslam/common/error.h"

namespace airslam {
namespace {

// A rig that is calibrated anew is another one: its pixels cannot stand in the same map.
bool IsSameCamera(const MapCalibration& a, const MapCalibration& b) {
  constexpr double kPixels = 1e-3, kMetres = 1e-5, kRadians = 1e-5;
  const Pinhole &p = a.stereo.camera, &q = b.stereo.camera;
  const Rigid3 difference = a.body_from_left.Inverse() * b.body_from_left;
  return p.width == q.width && p.height == q.height && std::abs(p.fx - q.fx) < kPixels &&
         std::abs(p.fy - q.fy) < kPixels && std::abs(p.cx - q.cx) < kPixels &&
         std::abs(p.cy - q.cy) < kPixels &&
         std::abs(a.stereo.baseline - b.stereo.baseline) < kMetres &&
         difference.translation.norm() < kMetres && difference.Angle() < kRadians;
}

template <class Id, class Value>
Id NextId(const std::map<Id, Value>& values) {
  return values.empty() ? 0 : values.rbegin()->first + 1;
}

void Shift(LandmarkId offset, std::vector<LandmarkId>& ids) {
  for (LandmarkId& id : ids) {
    if (id != kNoLandmark) id += offset;
  }
}

}  // namespace

void AppendMap(const Map& second, Map& first, const std::string& first_name,
               const std::string& second_name) {
  if (first.model_pack_sha256 != second.model_pack_sha256) {
    Fail("{} was made with model pack {}, {} with another one ({}): their features do not match",
         first_name, first.model_pack, second_name, second.model_pack);
  }
  if (!IsSameCamera(first.calibration, second.calibration)) {
    Fail("{} and {} were made with different cameras or calibrations", first_name, second_name);
  }
  const KeyframeId keyframe_offset = NextId(first.keyframes);
  const LandmarkId point_offset = NextId(first.landmarks);
  const LandmarkId line_offset = NextId(first.line_landmarks);
  int component_offset = 0;
  for (const auto& [id, keyframe] : first.keyframes) {
    component_offset = std::max(component_offset, keyframe.component + 1);
  }
  for (const auto& [id, keyframe] : second.keyframes) {
    Keyframe& added = first.keyframes[id + keyframe_offset] = keyframe;
    added.id = id + keyframe_offset;
    added.component += component_offset;
    Shift(point_offset, added.landmarks);
    Shift(line_offset, added.line_landmarks);
  }
  for (const auto& [id, landmark] : second.landmarks) {
    first.landmarks[id + point_offset] = {id + point_offset, landmark.point_in_world,
                                          landmark.first_seen_by + keyframe_offset};
  }
  for (const auto& [id, line] : second.line_landmarks) {
    first.line_landmarks[id + line_offset] = {id + line_offset, line.ends_in_world,
                                              line.first_seen_by + keyframe_offset};
  }
}

}  // namespace airslam
