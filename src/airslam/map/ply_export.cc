// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/map/ply_export.h"

#include <fmt/format.h>

#include <fstream>
#include <string>
#include <vector>

#include "airslam/common/atomic_file.h"
#include "airslam/common/error.h"
#include "airslam/map/keyframe_trajectory.h"

namespace airslam {
namespace {

constexpr char kPointColor[] = "160 160 160";
constexpr char kLineColor[] = "220 120 30";
constexpr char kCameraColor[] = "40 90 220";

// Vertices and edges as lines of text.
struct Ply {
  std::vector<std::string> vertices, edges;

  void AddVertex(const Eigen::Vector3d& p, const char* color) {
    vertices.push_back(fmt::format("{:.6f} {:.6f} {:.6f} {}\n", p.x(), p.y(), p.z(), color));
  }
  // Between the last two vertices.
  void JoinLastTwo() {
    edges.push_back(fmt::format("{} {}\n", vertices.size() - 2, vertices.size() - 1));
  }
};

Ply Collect(const Map& map, int component) {
  Ply ply;
  for (const auto& [id, landmark] : map.landmarks) {
    if (map.keyframes.at(landmark.first_seen_by).component != component) continue;
    ply.AddVertex(landmark.point_in_world, kPointColor);
  }
  for (const auto& [id, line] : map.line_landmarks) {
    if (map.keyframes.at(line.first_seen_by).component != component) continue;
    ply.AddVertex(line.ends_in_world.start, kLineColor);
    ply.AddVertex(line.ends_in_world.end, kLineColor);
    ply.JoinLastTwo();
  }
  bool first = true;
  for (const StampedPose& pose : MapTrajectory(map, component)) {
    ply.AddVertex(pose.world_from_body * map.calibration.body_from_left.translation, kCameraColor);
    if (!first) ply.JoinLastTwo();
    first = false;
  }
  return ply;
}

}  // namespace

void WritePly(const Map& map, int component, const std::filesystem::path& file) {
  const Ply ply = Collect(map, component);
  AtomicFile atomic(file);
  std::ofstream stream(atomic.partial(), std::ios::binary);
  stream << "ply\nformat ascii 1.0\ncomment AirSLAM map, metres\n"
         << "element vertex " << ply.vertices.size() << "\nproperty float x\nproperty float y\n"
         << "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
         << "element edge " << ply.edges.size() << "\nproperty int vertex1\nproperty int vertex2\n"
         << "end_header\n";
  for (const std::string& vertex : ply.vertices) stream << vertex;
  for (const std::string& edge : ply.edges) stream << edge;
  stream.close();
  if (!stream) Fail("{} cannot be written", file.string());
  atomic.Commit();
}

}  // namespace airslam
