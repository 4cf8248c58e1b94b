// SPDX-License-Identifier: BSD-3-Clause
#include "src/trajectory_binding.h"

#include <fmt/format.h>
#include <nanobind/nanobind.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/string.h>

#include <cstddef>
#include <filesystem>
#include <utility>
#include <vector>

#include "airslam/common/error.h"
#include "src/arrays.h"
#include "src/bindings.h"

namespace airslam::python {
namespace {

namespace fs = std::filesystem;
using nb::literals::operator""_a;
using Times = Array<std::int64_t, -1>;
using Poses = Array<double, -1, 4, 4>;
using GivenTimes = nb::ndarray<const std::int64_t, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using GivenPoses = nb::ndarray<const double, nb::shape<-1, 4, 4>, nb::c_contig, nb::device::cpu>;

TrajectoryView FromArrays(const GivenTimes& times, const GivenPoses& poses) {
  if (times.shape(0) != poses.shape(0)) {
    Fail("a trajectory of {} times and {} poses: expected as many", times.shape(0), poses.shape(0));
  }
  Trajectory trajectory;
  for (std::size_t i = 0; i < times.shape(0); ++i) {
    const Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>> matrix(poses.data() +
                                                                                16 * i);
    if (!matrix.allFinite()) Fail("pose {} of the trajectory is not finite", i);
    if (i > 0 && times.data()[i] <= times.data()[i - 1]) {
      Fail("time {} of the trajectory, {} ns, is not after the one before it", i, times.data()[i]);
    }
    trajectory.push_back({times.data()[i], Rigid3::FromMatrix(matrix)});
  }
  return TrajectoryView(std::move(trajectory));
}

}  // namespace

void BindTrajectory(nb::module_& module) {
  nb::class_<TrajectoryView>(module, "Trajectory", "Poses of the body in order of time.")
      .def_static(
          "load",
          [](const fs::path& file) {
            nb::gil_scoped_release release;
            return TrajectoryView(ReadTrajectory(file));
          },
          "file"_a,
          "Reads TUM, EuRoC ground truth csv or KITTI poses; which it is shows in the file. Raises "
          "Error that names file and line.")
      .def_static("from_arrays", &FromArrays, "timestamps_ns"_a, "world_from_body"_a,
                  "N int64 nanoseconds, ascending, and N x 4 x 4 float64 poses. Raises Error.")
      .def(
          "save_tum",
          [](const TrajectoryView& t, const fs::path& file) { WriteTum(file, t.poses()); },
          "file"_a, nb::call_guard<nb::gil_scoped_release>(),
          "Writes `seconds tx ty tz qx qy qz qw` a line; replaces the file as a whole.")
      .def_prop_ro(
          "timestamps_ns",
          [](const TrajectoryView& t) {
            std::vector<std::int64_t> times;
            for (const StampedPose& pose : t.poses()) times.push_back(pose.timestamp_ns);
            return ToArray<Times>(std::move(times), {t.poses().size()});
          },
          "N int64 nanoseconds.", nb::rv_policy::automatic)
      .def_prop_ro(
          "world_from_body",
          [](const TrajectoryView& t) {
            std::vector<double> numbers;
            for (const StampedPose& pose : t.poses()) AppendPose(pose.world_from_body, numbers);
            return ToArray<Poses>(std::move(numbers), {t.poses().size(), 4, 4});
          },
          "N x 4 x 4 float64.", nb::rv_policy::automatic)
      .def("__len__", [](const TrajectoryView& t) { return t.poses().size(); })
      .def("__repr__", [](const TrajectoryView& t) {
        return fmt::format("<airslam.Trajectory: {} poses>", t.poses().size());
      });
}

}  // namespace airslam::python
