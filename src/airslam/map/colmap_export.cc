// SPDX-License-Identifier: BSD-3-Clause
//
// Format: https://colmap.github.io/format.html#text-format
#include "airslam/map/colmap_export.h"

#include <fmt/format.h>
#include <fmt/ostream.h>

#include <fstream>
#include <map>
#include <set>
#include <vector>

#include "airslam/common/atomic_file.h"
#include "airslam/common/error.h"

namespace airslam {
namespace fs = std::filesystem;
namespace {

constexpr double kHalfPixel = 0.5;

// Keypoint `index` of a keyframe.
struct TrackElement {
  KeyframeId keyframe = -1;
  int index = -1;
};
using Tracks = std::map<LandmarkId, std::vector<TrackElement>>;

// Who sees each landmark of the component. An image that names one twice counts once.
Tracks CollectTracks(const Map& map, int component) {
  Tracks tracks;
  for (const auto& [id, keyframe] : map.keyframes) {
    if (keyframe.component != component) continue;
    for (std::size_t i = 0; i < keyframe.landmarks.size(); ++i) {
      if (!map.landmarks.contains(keyframe.landmarks[i])) continue;
      std::vector<TrackElement>& track = tracks[keyframe.landmarks[i]];
      if (!track.empty() && track.back().keyframe == id) continue;
      track.push_back({id, static_cast<int>(i)});
    }
  }
  return tracks;
}

// Pixels between the observation and the landmark's projection; 0 behind the camera.
double ReprojectionError(const Map& map, const Landmark& landmark, const TrackElement& element) {
  const Keyframe& keyframe = map.keyframes.at(element.keyframe);
  const Eigen::Vector3d point = keyframe.world_from_cam.Inverse() * landmark.point_in_world;
  if (point.z() <= 0) return 0;
  const Keypoint& keypoint = keyframe.keypoints[element.index];
  return (map.calibration.stereo.camera.Project(point) - Eigen::Vector2d(keypoint.x, keypoint.y))
      .norm();
}

void WriteCameras(const Map& map, std::ostream& stream) {
  const Pinhole& c = map.calibration.stereo.camera;
  fmt::print(stream, "# CAMERA_ID MODEL WIDTH HEIGHT FX FY CX CY\n");
  fmt::print(stream, "1 PINHOLE {} {} {:.9g} {:.9g} {:.9g} {:.9g}\n", c.width, c.height, c.fx, c.fy,
             c.cx + kHalfPixel, c.cy + kHalfPixel);
}

void WriteImages(const Map& map, int component, std::ostream& stream) {
  fmt::print(stream, "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME\n");
  fmt::print(stream, "# POINTS2D[] as X Y POINT3D_ID\n");
  for (const auto& [id, keyframe] : map.keyframes) {
    if (keyframe.component != component) continue;
    const Rigid3 cam_from_world = keyframe.world_from_cam.Inverse();
    const Eigen::Quaterniond& q = cam_from_world.rotation;
    const Eigen::Vector3d& t = cam_from_world.translation;
    fmt::print(stream, "{} {:.12g} {:.12g} {:.12g} {:.12g} {:.9g} {:.9g} {:.9g} 1 {}.png\n", id + 1,
               q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z(), keyframe.timestamp_ns);
    std::set<LandmarkId> named;
    for (std::size_t i = 0; i < keyframe.keypoints.size(); ++i) {
      const LandmarkId landmark = keyframe.landmarks[i];
      const bool sees = map.landmarks.contains(landmark) && named.insert(landmark).second;
      fmt::print(stream, "{}{:.3f} {:.3f} {}", i == 0 ? "" : " ",
                 keyframe.keypoints[i].x + kHalfPixel, keyframe.keypoints[i].y + kHalfPixel,
                 sees ? landmark + 1 : -1);
    }
    fmt::print(stream, "\n");
  }
}

void WritePoints(const Map& map, const Tracks& tracks, std::ostream& stream) {
  fmt::print(stream, "# POINT3D_ID X Y Z R G B ERROR TRACK[] as IMAGE_ID POINT2D_IDX\n");
  for (const auto& [id, track] : tracks) {
    const Landmark& landmark = map.landmarks.at(id);
    double error = 0;
    for (const TrackElement& element : track) error += ReprojectionError(map, landmark, element);
    const Eigen::Vector3d& p = landmark.point_in_world;
    fmt::print(stream, "{} {:.9g} {:.9g} {:.9g} 160 160 160 {:.4f}", id + 1, p.x(), p.y(), p.z(),
               error / static_cast<double>(track.size()));
    for (const TrackElement& e : track) fmt::print(stream, " {} {}", e.keyframe + 1, e.index);
    fmt::print(stream, "\n");
  }
}

template <class Write>
void WriteFile(const fs::path& file, Write&& write) {
  AtomicFile atomic(file);
  std::ofstream stream(atomic.partial(), std::ios::binary);
  write(stream);
  stream.close();
  if (!stream) Fail("{} cannot be written", file.string());
  atomic.Commit();
}

}  // namespace

void WriteColmap(const Map& map, int component, const fs::path& folder) {
  const Tracks tracks = CollectTracks(map, component);
  WriteFile(folder / "cameras.txt", [&](std::ostream& stream) { WriteCameras(map, stream); });
  WriteFile(folder / "images.txt",
            [&](std::ostream& stream) { WriteImages(map, component, stream); });
  WriteFile(folder / "points3D.txt",
            [&](std::ostream& stream) { WritePoints(map, tracks, stream); });
}

}  // namespace airslam
