// SPDX-License-Identifier: BSD-3-Clause
#include "src/frame_binding.h"

#include <fmt/format.h>
#include <nanobind/nanobind.h>
#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
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

using Vector3 = Array<double, 3>;

// A vector of the IMU's part; nothing where that is not known.
template <typename F>
std::optional<Vector3> InertialVector(const Frame& frame, F&& vector) {
  if (!frame.inertial) return std::nullopt;
  const Eigen::Vector3d& v = vector(*frame.inertial);
  return ToArray<Vector3>(std::vector<double>(v.data(), v.data() + 3), {3});
}

void BindTracked(nb::class_<Frame>& frame) {
  frame
      .def_prop_ro(
          "tracked_pixels",
          [](const Frame& f) {
            std::vector<double> numbers;
            for (const TrackedPoint& p : f.points) {
              numbers.insert(numbers.end(), {p.pixel.x(), p.pixel.y()});
            }
            return ToArray<Array<double, -1, 2>>(std::move(numbers), {f.points.size(), 2});
          },
          "N x 2 float64: where the left image shows the landmarks that hold the frame's pose.",
          nb::rv_policy::automatic)
      .def_prop_ro(
          "tracked_ids",
          [](const Frame& f) {
            std::vector<std::int64_t> ids;
            for (const TrackedPoint& p : f.points) ids.push_back(p.landmark);
            return ToArray<Array<std::int64_t, -1>>(std::move(ids), {f.points.size()});
          },
          "N int64: the ids of these landmarks, those of the map. Bundle adjustment may drop one "
          "as an outlier later.",
          nb::rv_policy::automatic)
      .def_prop_ro(
          "keyframe", [](const Frame& f) { return f.keyframe; },
          "The Keyframe that it became, with its landmarks as they were made, before any bundle "
          "adjustment, and without lines yet; None where it became none.",
          nb::sig("def keyframe(self) -> Keyframe | None"))
      .def_prop_ro(
          "lined", [](const Frame& f) { return f.lined; },
          "The Keyframe before it, whose lines have been found by now: on another thread while the "
          "frames between were tracked. None with most frames; the last keyframe of a run has its "
          "lines in the map only.",
          nb::sig("def lined(self) -> Keyframe | None"));
}

void BindInertial(nb::class_<Frame>& frame) {
  frame
      .def_prop_ro(
          "velocity",
          [](const Frame& f) {
            return InertialVector(f, [](const auto& i) { return i.velocity_in_world; });
          },
          "3 float64, m/s: of the body, in the world of world_from_body. This and what follows is "
          "None until the IMU is initialised, and where the frame has no pose.",
          nb::rv_policy::automatic)
      .def_prop_ro(
          "gyroscope_bias",
          [](const Frame& f) {
            return InertialVector(f, [](const auto& i) { return i.bias.gyroscope; });
          },
          "3 float64, rad/s; or None.", nb::rv_policy::automatic)
      .def_prop_ro(
          "accelerometer_bias",
          [](const Frame& f) {
            return InertialVector(f, [](const auto& i) { return i.bias.accelerometer; });
          },
          "3 float64, m/s^2; or None.", nb::rv_policy::automatic)
      .def_prop_ro(
          "gravity",
          [](const Frame& f) {
            return InertialVector(f, [](const auto& i) { return i.gravity_in_world; });
          },
          "3 float64, m/s^2, downwards in the world of world_from_body; or None.",
          nb::rv_policy::automatic);
}

}  // namespace

Frame MakeFrame(const FrameObservation& seen, const Rigid3& body_from_cam) {
  const PreparedFrame& prepared = seen.prepared;
  const FrameRecord& record = seen.record;
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
  if (seen.features != nullptr) frame.keypoints = seen.features->keypoints;
  frame.points.assign(seen.points.begin(), seen.points.end());
  if (seen.keyframe != nullptr) frame.keyframe = std::make_shared<Keyframe>(*seen.keyframe);
  if (seen.lined != nullptr) frame.lined = std::make_shared<Keyframe>(*seen.lined);
  frame.inertial = seen.inertial;
  return frame;
}

void BindFrame(nb::module_& module) {
  nb::class_<Frame> frame(module, "Frame",
                          "What a run knows of a frame as soon as it has been tracked.");
  BindTracked(frame);
  BindInertial(frame);
  frame.def_ro("index", &Frame::index, "Running number of the frame.")
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
          "N x 2 pixels of the rectified left image, best first: all that PLNet detected, where "
          "the frame needed it (each keyframe does). Most frames are tracked by the landmarks' "
          "patches alone, and have none; 'points' has what was tracked.",
          nb::rv_policy::automatic)
      .def_ro("stage_ms", &Frame::stage_ms,
              "Milliseconds that each stage of the pipeline has worked since the frame before was "
              "reported. "
              "Stages work on several threads and on frames to come.")
      .def("__repr__", [](const Frame& f) {
        return fmt::format("<airslam.Frame {}: {}, {} points>", f.index, f.state, f.tracked_points);
      });
}

}  // namespace airslam::python
