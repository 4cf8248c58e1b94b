// SPDX-License-Identifier: BSD-3-Clause
#include "src/frame_binding.h"

#include <fmt/format.h>
#include <nanobind/nanobind.h>
#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include "airslam/odometry/report.h"
#include "src/arrays.h"
#include "src/bindings.h"

namespace airslam::python {
namespace {

using Image = nb::ndarray<nb::numpy, const std::uint8_t, nb::shape<-1, -1>, nb::c_contig>;

// The image without a copy; the array keeps its pixels.
std::optional<Image> ToImage(const cv::Mat& image) {
  if (image.empty()) return std::nullopt;
  auto* kept = new cv::Mat(image.isContinuous() ? image : image.clone());
  nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<cv::Mat*>(p); });
  return Image(kept->data,
               {static_cast<std::size_t>(kept->rows), static_cast<std::size_t>(kept->cols)}, owner);
}

}  // namespace

Frame MakeFrame(const PreparedFrame& prepared, const FrameRecord& record,
                const Rigid3& body_from_cam) {
  Frame frame;
  frame.index = prepared.index;
  frame.timestamp_ns = record.timestamp_ns;
  frame.state = StateName(record.state);
  frame.problem = prepared.problem;
  frame.component = record.component;
  if (record.has_pose()) {
    frame.world_from_body = record.online_world_from_cam * body_from_cam.Inverse();
  }
  frame.is_keyframe = record.is_keyframe;
  frame.tracked_points = record.tracked_points;
  frame.milliseconds = record.milliseconds;
  frame.left = prepared.left;
  frame.keypoints = prepared.features.keypoints;
  return frame;
}

void BindFrame(nb::module_& module) {
  nb::class_<Frame>(module, "Frame", "What a run knows of a frame as soon as it has been tracked.")
      .def_ro("index", &Frame::index, "Running number of the frame.")
      .def_ro("timestamp_ns", &Frame::timestamp_ns, "Nanoseconds.")
      .def_ro(
          "state", &Frame::state,
          "'initialized' (first of a component), 'tracked', 'inertial' (the IMU carries the pose), "
          "'lost' or 'skipped' (its images could not be used).")
      .def_ro("problem", &Frame::problem, "Why it was skipped; else empty.")
      .def_ro("component", &Frame::component, "Whose world the pose is in; -1 without a pose.")
      .def_prop_ro(
          "world_from_body",
          [](const Frame& f) -> std::optional<Matrix4Array> {
            if (!f.world_from_body) return std::nullopt;
            return ToArray(*f.world_from_body);
          },
          "4x4 as first estimated, or None. The world of a component is its first body's frame; z "
          "points up in the results only.",
          nb::rv_policy::automatic)
      .def_ro("is_keyframe", &Frame::is_keyframe, "Whether it became a keyframe.")
      .def_ro("tracked_points", &Frame::tracked_points, "Landmarks that hold its pose.")
      .def_ro("milliseconds", &Frame::milliseconds, "That tracking it took.")
      .def_prop_ro(
          "left", [](const Frame& f) { return ToImage(f.left); },
          "The rectified left image, uint8 height x width, read-only; None when it was skipped.",
          nb::rv_policy::automatic)
      .def_prop_ro(
          "keypoints", [](const Frame& f) { return Pixels(f.keypoints); },
          "N x 2 pixels of the rectified left image, best first.", nb::rv_policy::automatic)
      .def_ro("stage_ms", &Frame::stage_ms,
              "Milliseconds that each stage of the pipeline has worked since the frame before was "
              "reported. "
              "Stages work on several threads and on frames to come.")
      .def("__repr__", [](const Frame& f) {
        return fmt::format("<airslam.Frame {}: {}, {} points>", f.index, f.state, f.tracked_points);
      });
}

}  // namespace airslam::python
