// SPDX-License-Identifier: BSD-3-Clause
#include <nanobind/nanobind.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "airslam/common/error.h"
#include "airslam/dataset/sequence.h"
#include "airslam/dataset/trajectory.h"
#include "airslam/evaluate/error_json.h"
#include "airslam/geometry/alignment.h"
#include "src/arrays.h"
#include "src/bindings.h"
#include "src/json.h"
#include "src/trajectory_binding.h"

namespace airslam::python {
namespace {

namespace fs = std::filesystem;
using nb::literals::operator""_a;

TrajectoryAlignment AlignmentNamed(const std::string& name) {
  if (name == "se3") return TrajectoryAlignment::kSe3;
  if (name == "sim3") return TrajectoryAlignment::kSim3;
  if (name == "none") return TrajectoryAlignment::kNone;
  Fail("alignment '{}' is unknown: expected se3, sim3 or none", name);
}

// A trajectory as it is, or read from the file that a path names.
Trajectory TrajectoryFrom(const nb::object& given) {
  if (nb::isinstance<TrajectoryView>(given)) return nb::cast<TrajectoryView&>(given).poses();
  const auto file = nb::cast<fs::path>(given);
  nb::gil_scoped_release release;
  return ReadTrajectory(file);
}

nb::object Evaluate(const nb::object& groundtruth, const nb::object& estimate,
                    const std::string& alignment, int delta, double max_time_difference,
                    const std::optional<fs::path>& dataset) {
  const Trajectory truth = TrajectoryFrom(groundtruth), estimated = TrajectoryFrom(estimate);
  std::string text;
  {
    nb::gil_scoped_release release;
    EvaluationOptions options;
    options.alignment = AlignmentNamed(alignment);
    options.rpe_delta = delta;
    options.max_time_difference = max_time_difference;
    std::vector<std::int64_t> times;
    if (dataset) {
      const std::unique_ptr<Sequence> sequence = OpenSequence(*dataset);
      for (int i = 0; i < sequence->size(); ++i) times.push_back(sequence->timestamp_ns(i));
    }
    text = ToJson(EvaluateTrajectory(truth, estimated, options, times)).dump();
  }
  return ToPython(text);
}

using GivenPoints = nb::ndarray<const double, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Rows = Array<std::int64_t, -1>;

std::vector<Eigen::Vector3d> PointsOf(const GivenPoints& array) {
  std::vector<Eigen::Vector3d> points;
  for (std::size_t i = 0; i < array.shape(0); ++i) {
    points.emplace_back(Eigen::Map<const Eigen::Vector3d>(array.data() + 3 * i));
  }
  return points;
}

std::optional<Matrix4Array> Align(const GivenPoints& source, const GivenPoints& target) {
  const auto aligned = AlignPoints(PointsOf(source), PointsOf(target), false);
  if (!aligned) return std::nullopt;
  return ToArray(Rigid3(aligned->rotation, aligned->translation));
}

std::pair<Rows, Rows> Associate(const TrajectoryView& groundtruth, const TrajectoryView& estimate,
                                double max_time_difference) {
  std::vector<std::int64_t> of_truth, of_estimate;
  for (const PosePair& pair :
       AssociateByTime(groundtruth.poses(), estimate.poses(), max_time_difference)) {
    of_truth.push_back(pair.groundtruth);
    of_estimate.push_back(pair.estimate);
  }
  const std::size_t count = of_truth.size();
  return {ToArray<Rows>(std::move(of_truth), {count}),
          ToArray<Rows>(std::move(of_estimate), {count})};
}

}  // namespace

void BindEvaluation(nb::module_& module) {
  module.def("align", &Align, "source"_a, "target"_a,
             "The rigid 4x4 target_from_source that minimises |T source - target|^2 over N x 3 "
             "points; None when it is not determined (fewer than three, or on one line).",
             nb::rv_policy::automatic);
  module.def(
      "associate", &Associate, "groundtruth"_a, "estimate"_a,
      "max_time_difference"_a = EvaluationOptions().max_time_difference,
      "Rows of poses of the same time in both trajectories, as evaluate compares them: each "
      "of the shorter one with the nearest of the longer one, at most so many seconds away.");
  module.def(
      "evaluate", &Evaluate, "groundtruth"_a, "estimate"_a, nb::kw_only(), "alignment"_a = "se3",
      "delta"_a = 1, "max_time_difference"_a = EvaluationOptions().max_time_difference,
      "dataset"_a = nb::none(),
      nb::sig(
          "def evaluate(groundtruth: Trajectory | str | os.PathLike, estimate: Trajectory | str | "
          "os.PathLike, *, alignment: str = 'se3', delta: int = 1, max_time_difference: float = "
          "0.01, dataset: str | os.PathLike | None = None) -> dict"),
      "Compares a trajectory with its ground truth, as `airslam eval --json` does: a dict with "
      "ate_position_m, rpe_translation_m and rpe_rotation_deg (each rmse, mean, median, max, "
      "count), "
      "coverage and what they rest on.\n\n"
      "Both may be trajectories or files (TUM, EuRoC csv, KITTI poses). alignment: 'se3', 'sim3' "
      "or "
      "'none'. delta: frames between relative poses. max_time_difference: seconds between poses "
      "that "
      "are compared. dataset: the sequence's folder; the coverage then counts its frames.");
}

}  // namespace airslam::python
