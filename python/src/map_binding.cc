// SPDX-License-Identifier: BSD-3-Clause
#include "src/map_binding.h"

#include <fmt/format.h>
#include <nanobind/nanobind.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/unique_ptr.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <string>
#include <tuple>
#include <unordered_map>

#include "airslam/common/error.h"
#include "airslam/map/keyframe_trajectory.h"
#include "airslam/map/map_file.h"
#include "airslam/map/map_summary.h"
#include "src/arrays.h"
#include "src/bindings.h"
#include "src/json.h"

namespace airslam::python {
namespace {

namespace fs = std::filesystem;
using nb::literals::operator""_a;

using Ids = Array<std::int64_t, -1>;
using Doubles3 = Array<double, -1, 3>;
using Poses = Array<double, -1, 4, 4>;
using Floats = Array<float, -1>;
using Floats4 = Array<float, -1, 4>;
using Lines = Array<double, -1, 2, 3>;
using Observations = Array<std::int64_t, -1, 3>;

// One number for each keyframe.
template <typename F>
Ids KeyframeIds(const MapView& view, F&& number) {
  std::vector<std::int64_t> numbers;
  for (const Keyframe* keyframe : view.keyframes()) numbers.push_back(number(*keyframe));
  return ToArray<Ids>(std::move(numbers), {view.keyframes().size()});
}

// One pose for each keyframe.
template <typename F>
Poses KeyframePoses(const MapView& view, F&& pose) {
  std::vector<double> numbers;
  for (const Keyframe* keyframe : view.keyframes()) AppendPose(pose(*keyframe), numbers);
  return ToArray<Poses>(std::move(numbers), {view.keyframes().size(), 4, 4});
}

// One vector for each keyframe with an inertial state, not-a-number for the others.
Doubles3 InertialVectors(const MapView& view, Eigen::Vector3d Keyframe::*member) {
  std::vector<double> numbers;
  for (const Keyframe* keyframe : view.keyframes()) {
    const Eigen::Vector3d& v = keyframe->*member;
    for (int i = 0; i < 3; ++i) numbers.push_back(keyframe->has_inertial_state ? v[i] : NAN);
  }
  return ToArray<Doubles3>(std::move(numbers), {view.keyframes().size(), 3});
}

template <typename Landmarks>
Ids LandmarkIds(const Landmarks& landmarks) {
  std::vector<std::int64_t> ids;
  for (const auto& [id, landmark] : landmarks) ids.push_back(id);
  const std::size_t count = ids.size();
  return ToArray<Ids>(std::move(ids), {count});
}

Doubles3 Points(const MapView& view) {
  std::vector<double> numbers;
  for (const auto& [id, landmark] : view.map().landmarks) {
    const Eigen::Vector3d& p = landmark.point_in_world;
    numbers.insert(numbers.end(), p.data(), p.data() + 3);
  }
  return ToArray<Doubles3>(std::move(numbers), {view.map().landmarks.size(), 3});
}

Lines LineEnds(const MapView& view) {
  std::vector<double> numbers;
  for (const auto& [id, line] : view.map().line_landmarks) {
    for (const Eigen::Vector3d& end : {line.ends_in_world.start, line.ends_in_world.end}) {
      numbers.insert(numbers.end(), end.data(), end.data() + 3);
    }
  }
  return ToArray<Lines>(std::move(numbers), {view.map().line_landmarks.size(), 2, 3});
}

// The component of each landmark: that of the keyframe that saw it first.
template <typename Landmarks>
Ids LandmarkComponents(const Map& map, const Landmarks& landmarks) {
  std::vector<std::int64_t> numbers;
  for (const auto& [id, landmark] : landmarks) {
    const auto keyframe = map.keyframes.find(landmark.first_seen_by);
    numbers.push_back(keyframe == map.keyframes.end() ? -1 : keyframe->second.component);
  }
  const std::size_t count = numbers.size();
  return ToArray<Ids>(std::move(numbers), {count});
}

// Rows (keyframe, feature, landmark), all three as rows of the arrays above.
template <typename Landmarks>
Observations Observed(const MapView& view, std::vector<LandmarkId> Keyframe::*column,
                      const Landmarks& landmarks) {
  std::unordered_map<LandmarkId, std::int64_t> rows;
  for (const auto& [id, landmark] : landmarks) rows.emplace(id, std::ssize(rows));
  std::vector<std::int64_t> numbers;
  for (std::size_t k = 0; k < view.keyframes().size(); ++k) {
    const std::vector<LandmarkId>& ids = view.keyframes()[k]->*column;
    for (std::size_t i = 0; i < ids.size(); ++i) {
      const auto row = rows.find(ids[i]);
      if (row == rows.end()) continue;
      numbers.push_back(static_cast<std::int64_t>(k));
      numbers.push_back(static_cast<std::int64_t>(i));
      numbers.push_back(row->second);
    }
  }
  const std::size_t count = numbers.size() / 3;
  return ToArray<Observations>(std::move(numbers), {count, 3});
}

Floats4 Segments(const std::vector<LineSegment>& lines) {
  std::vector<float> numbers;
  for (const LineSegment& s : lines) {
    const bool is_there = s.score >= 0;
    for (float x : {s.x1, s.y1, s.x2, s.y2}) numbers.push_back(is_there ? x : NAN);
  }
  return ToArray<Floats4>(std::move(numbers), {lines.size(), 4});
}

template <typename Feature>
Floats Scores(const std::vector<Feature>& features) {
  std::vector<float> numbers;
  for (const Feature& f : features) numbers.push_back(f.score);
  return ToArray<Floats>(std::move(numbers), {features.size()});
}

Floats RightColumns(const Keyframe& keyframe) {
  std::vector<float> numbers;
  for (float x : keyframe.right_x) numbers.push_back(x >= 0 ? x : NAN);
  return ToArray<Floats>(std::move(numbers), {keyframe.right_x.size()});
}

Ids IdColumn(const std::vector<LandmarkId>& ids) {
  return ToArray<Ids>(std::vector<std::int64_t>(ids), {ids.size()});
}

void BindCalibration(nb::module_& module) {
  nb::class_<MapCalibration>(
      module, "Calibration",
      "The rectified stereo camera of a run or map: both images share one pinhole camera without "
      "distortion, rows correspond.")
      .def_prop_ro(
          "camera_matrix",
          [](const MapCalibration& c) {
            const Pinhole& p = c.stereo.camera;
            return ToArray<Array<double, 3, 3>>(
                std::vector<double>{p.fx, 0, p.cx, 0, p.fy, p.cy, 0, 0, 1}, {3, 3});
          },
          "3x3, pixels.", nb::rv_policy::automatic)
      .def_prop_ro(
          "image_size",
          [](const MapCalibration& c) {
            return nb::make_tuple(c.stereo.camera.width, c.stereo.camera.height);
          },
          nb::sig("def image_size(self) -> tuple[int, int]"), "(width, height) in pixels.",
          nb::rv_policy::automatic)
      .def_prop_ro(
          "baseline", [](const MapCalibration& c) { return c.stereo.baseline; },
          "Metres between the optical centres.", nb::rv_policy::automatic)
      .def_prop_ro(
          "body_from_camera", [](const MapCalibration& c) { return ToArray(c.body_from_left); },
          "4x4: rectified left camera to body.", nb::rv_policy::automatic)
      .def_ro("has_imu", &MapCalibration::has_imu, "Whether the body is an IMU's frame.");
}

void BindKeyframe(nb::module_& module) {
  nb::class_<Keyframe>(
      module, "Keyframe",
      "A frame that is part of a map. Pixels are those of the rectified left image.")
      .def_ro("id", &Keyframe::id, "Its number in the map.")
      .def_ro("timestamp_ns", &Keyframe::timestamp_ns, "Nanoseconds.")
      .def_ro("component", &Keyframe::component,
              "Keyframes of different components share no world frame.")
      .def_prop_ro(
          "world_from_camera", [](const Keyframe& k) { return ToArray(k.world_from_cam); },
          "4x4: rectified left camera to world.", nb::rv_policy::automatic)
      .def_prop_ro(
          "keypoints", [](const Keyframe& k) { return Pixels(k.keypoints); },
          "N x 2 pixels; the rows of descriptors, scores, right_x and landmark_ids belong to them.",
          nb::rv_policy::automatic)
      .def_prop_ro(
          "scores", [](const Keyframe& k) { return Scores(k.keypoints); },
          "N: the network's score, larger is better.", nb::rv_policy::automatic)
      .def_prop_ro(
          "descriptors", [](const Keyframe& k) { return Rows(k.descriptors); },
          "N x D, rows of unit length.", nb::rv_policy::automatic)
      .def_prop_ro("right_x", &RightColumns,
                   "N: column of the match in the right image, NaN without one.",
                   nb::rv_policy::automatic)
      .def_prop_ro(
          "landmark_ids", [](const Keyframe& k) { return IdColumn(k.landmarks); },
          "N: ids of the landmarks that the keypoints see, -1 without one.",
          nb::rv_policy::automatic)
      .def_prop_ro(
          "lines", [](const Keyframe& k) { return Segments(k.lines); },
          "M x 4: x1, y1, x2, y2 in pixels.", nb::rv_policy::automatic)
      .def_prop_ro(
          "line_scores", [](const Keyframe& k) { return Scores(k.lines); },
          "M: probability that it is a line.", nb::rv_policy::automatic)
      .def_prop_ro(
          "right_lines", [](const Keyframe& k) { return Segments(k.right_lines); },
          "M x 4: the match in the right image, NaN without one.", nb::rv_policy::automatic)
      .def_prop_ro(
          "line_landmark_ids", [](const Keyframe& k) { return IdColumn(k.line_landmarks); },
          "M: ids of the line landmarks that the lines see, -1 without one.",
          nb::rv_policy::automatic)
      .def_prop_ro(
          "junctions", [](const Keyframe& k) { return Pixels(k.junctions); },
          "J x 2 pixels: the ends of the lines.", nb::rv_policy::automatic)
      .def_prop_ro(
          "junction_descriptors", [](const Keyframe& k) { return Rows(k.junction_descriptors); },
          "J x D, rows of unit length.", nb::rv_policy::automatic);
}

void BindArrays(nb::class_<MapView>& map) {
  map.def_prop_ro(
         "keyframe_ids",
         [](const MapView& v) { return KeyframeIds(v, [](const Keyframe& k) { return k.id; }); },
         "K: ids of the keyframes, ascending. The rows of all arrays of keyframes belong to them.",
         nb::rv_policy::automatic)
      .def_prop_ro(
          "timestamps_ns",
          [](const MapView& v) {
            return KeyframeIds(v, [](const Keyframe& k) { return k.timestamp_ns; });
          },
          "K: nanoseconds.", nb::rv_policy::automatic)
      .def_prop_ro(
          "components",
          [](const MapView& v) {
            return KeyframeIds(v, [](const Keyframe& k) { return k.component; });
          },
          "K: keyframes of different components share no world frame.", nb::rv_policy::automatic)
      .def_prop_ro(
          "world_from_body",
          [](const MapView& v) {
            const Rigid3 cam_from_body = v.map().calibration.body_from_left.Inverse();
            return KeyframePoses(
                v, [&](const Keyframe& k) { return k.world_from_cam * cam_from_body; });
          },
          "K x 4 x 4: poses of the keyframes' bodies.", nb::rv_policy::automatic)
      .def_prop_ro(
          "world_from_camera",
          [](const MapView& v) {
            return KeyframePoses(v, [](const Keyframe& k) { return k.world_from_cam; });
          },
          "K x 4 x 4: poses of the rectified left cameras.", nb::rv_policy::automatic)
      .def_prop_ro(
          "velocities",
          [](const MapView& v) { return InertialVectors(v, &Keyframe::velocity_in_world); },
          "K x 3: velocity of the body in world, m/s; NaN where it is not known.",
          nb::rv_policy::automatic)
      .def_prop_ro(
          "gyroscope_biases",
          [](const MapView& v) { return InertialVectors(v, &Keyframe::gyroscope_bias); },
          "K x 3: rad/s; NaN where it is not known.", nb::rv_policy::automatic)
      .def_prop_ro(
          "accelerometer_biases",
          [](const MapView& v) { return InertialVectors(v, &Keyframe::accelerometer_bias); },
          "K x 3: m/s^2; NaN where it is not known.", nb::rv_policy::automatic)
      .def_prop_ro(
          "landmark_ids", [](const MapView& v) { return LandmarkIds(v.map().landmarks); },
          "N: ids of the points, ascending. The rows of all arrays of points belong to them.",
          nb::rv_policy::automatic)
      .def_prop_ro("landmarks", &Points, "N x 3: points in world, metres.",
                   nb::rv_policy::automatic)
      .def_prop_ro(
          "landmark_components",
          [](const MapView& v) { return LandmarkComponents(v.map(), v.map().landmarks); },
          "N: the component in whose world each point lies.", nb::rv_policy::automatic)
      .def_prop_ro(
          "line_ids", [](const MapView& v) { return LandmarkIds(v.map().line_landmarks); },
          "L: ids of the lines, ascending, numbered apart from the points.",
          nb::rv_policy::automatic)
      .def_prop_ro("lines", &LineEnds, "L x 2 x 3: both ends of each line in world, metres.",
                   nb::rv_policy::automatic)
      .def_prop_ro(
          "line_components",
          [](const MapView& v) { return LandmarkComponents(v.map(), v.map().line_landmarks); },
          "L: the component in whose world each line lies.", nb::rv_policy::automatic)
      .def_prop_ro(
          "observations",
          [](const MapView& v) { return Observed(v, &Keyframe::landmarks, v.map().landmarks); },
          "O x 3: which keyframe sees which point with which keypoint, as rows of keyframe_ids, of "
          "that keyframe's keypoints, and of landmark_ids.",
          nb::rv_policy::automatic)
      .def_prop_ro(
          "line_observations",
          [](const MapView& v) {
            return Observed(v, &Keyframe::line_landmarks, v.map().line_landmarks);
          },
          "P x 3: likewise for lines.", nb::rv_policy::automatic);
}

const Keyframe& KeyframeAt(const MapView& view, std::int64_t row) {
  const std::int64_t count = std::ssize(view.keyframes());
  if (row < -count || row >= count) {
    throw nb::index_error(fmt::format("the map has {} keyframes, not one {}", count, row).c_str());
  }
  return *view.keyframes()[row < 0 ? row + count : row];
}

}  // namespace

MapView::MapView(Map map) : map_(std::move(map)) {
  for (const auto& [id, keyframe] : map_.keyframes) keyframes_.push_back(&keyframe);
}

void BindMap(nb::module_& module) {
  BindCalibration(module);
  BindKeyframe(module);
  nb::class_<MapView> map(module, "Map",
                          "A map as numpy arrays. Every access makes a new array, so keep the ones "
                          "that a loop needs.");
  map.def_static(
      "load",
      [](const fs::path& file) {
        nb::gil_scoped_release release;
        return std::make_unique<MapView>(ReadMap(MapFilePath(file)));
      },
      "file"_a,
      "Reads a map file, or map.db of the folder that a run wrote; also one whose writer is still "
      "at "
      "work. Raises Error when it is no map, damaged, or of a newer version.");
  BindArrays(map);
  map.def("keyframe", &KeyframeAt, "row"_a, nb::rv_policy::reference_internal,
          "The keyframe of a row of keyframe_ids. Raises IndexError.")
      .def_prop_ro(
          "largest_component", [](const MapView& v) { return LargestMapComponent(v.map()); },
          "The component with the most keyframes, as in trajectory.tum; -1 of an empty map.")
      .def("__len__", [](const MapView& v) { return v.keyframes().size(); })
      .def_prop_ro(
          "calibration", [](const MapView& v) { return v.map().calibration; },
          "The rectified stereo camera that the map was made with.", nb::rv_policy::automatic)
      .def_prop_ro(
          "model_pack", [](const MapView& v) { return v.map().model_pack; },
          "Name of the model pack whose network made the descriptors.", nb::rv_policy::automatic)
      .def("__repr__", [](const MapView& v) {
        return fmt::format("<airslam.Map: {} keyframes, {} points, {} lines>", v.keyframes().size(),
                           v.map().landmarks.size(), v.map().line_landmarks.size());
      });
  module.def(
      "info",
      [](const fs::path& file) {
        std::string text;
        {
          nb::gil_scoped_release release;
          text = MapSummaryToJson(SummarizeMap(MapFilePath(file))).dump();
        }
        return ToPython(text);
      },
      "file"_a, nb::sig("def info(file: str | os.PathLike) -> dict"),
      "What `airslam info --json` says of a map file: counts, sizes and a digest of its content.");
}

}  // namespace airslam::python
