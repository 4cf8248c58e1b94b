// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <nanobind/nanobind.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "airslam/map/map_file.h"
#include "airslam/neural/make_matcher.h"
#include "airslam/neural/plnet.h"
#include "airslam/relocalize/localizer.h"
#include "src/arrays.h"
#include "src/bindings.h"
#include "src/config.h"
#include "src/images.h"

namespace airslam::python {
namespace {

namespace fs = std::filesystem;
using nb::literals::operator""_a;

// The configuration's options, then those that are given by themselves, as in the program.
LocalizationOptions OptionsFrom(const Config& config, const std::optional<int>& candidates,
                                const std::optional<bool>& structure_graph) {
  LocalizationOptions options;
  config.Load(options);
  if (candidates) options.candidates = *candidates;
  if (structure_graph) options.structure_graph = *structure_graph;
  options.Validate();
  return options;
}

// A map in memory with the networks that find images in it.
class MapLocalizer {
 public:
  MapLocalizer(const fs::path& map, const RigCamera& camera, const Config& config,
               const fs::path& model, const std::optional<int>& candidates,
               const std::optional<bool>& structure_graph)
      : options_(OptionsFrom(config, candidates, structure_graph)),
        pack_(LoadModelPack(model.string())),
        map_(LocalizationMap::Load(MapFilePath(map), pack_)),
        camera_(camera),
        detector_(pack_.features),
        matcher_(MakeMatcher(pack_)),
        localizer_(map_, detector_, *matcher_, options_) {}

  // From any thread, one after the other.
  Localization Localize(const cv::Mat& image) {
    const std::lock_guard lock(mutex_);
    return localizer_.Localize(image, camera_);
  }

 private:
  const LocalizationOptions options_;
  const ModelPack pack_;
  const LocalizationMap map_;
  const QueryCamera camera_;
  PlNet detector_;
  const std::unique_ptr<FeatureMatcher> matcher_;
  Localizer localizer_;
  std::mutex mutex_;
};

Array<double, 6, 6> Covariance(const LocalizedPose& pose) {
  const Matrix6d& m = pose.covariance;  // symmetric
  return ToArray<Array<double, 6, 6>>(std::vector<double>(m.data(), m.data() + 36), {6, 6});
}

void BindLocation(nb::module_& module) {
  nb::class_<Localization>(module, "Location",
                           "Where an image was taken, or why that cannot be told.")
      .def("__bool__", [](const Localization& l) { return l.pose.has_value(); })
      .def_prop_ro(
          "world_from_body",
          [](const Localization& l) -> std::optional<Matrix4Array> {
            if (!l.pose) return std::nullopt;
            return ToArray(l.pose->world_from_body);
          },
          nb::rv_policy::automatic, "4x4, or None where the query is refused.")
      .def_prop_ro(
          "covariance",
          [](const Localization& l) -> std::optional<Array<double, 6, 6>> {
            if (!l.pose) return std::nullopt;
            return Covariance(*l.pose);
          },
          nb::rv_policy::automatic,
          "6x6: rotation about the body's axes (rad), position in world (m); or None.")
      .def_ro("refusal", &Localization::refusal, "Why there is no pose, a sentence; else empty.")
      .def_prop_ro(
          "stage", [](const Localization& l) { return std::string(ToString(l.stage)); },
          "How far the query came: 'detect', 'retrieve', 'filter' or 'verify'.")
      .def_prop_ro(
          "inliers", [](const Localization& l) { return l.pose ? l.pose->inliers : 0; },
          "Points of the map that hold the pose.")
      .def_prop_ro(
          "keyframe_id", [](const Localization& l) { return l.pose ? l.pose->keyframe : -1; },
          "The keyframe that was matched; -1 without a pose.")
      .def_prop_ro(
          "component", [](const Localization& l) { return l.pose ? l.pose->component : -1; },
          "Of the map, whose world the pose is in; -1 without a pose.")
      .def_prop_ro(
          "milliseconds",
          [](const Localization& l) {
            const auto& ms = l.milliseconds;
            return std::map<std::string, double>{{"undistort", ms.undistort},
                                                 {"detect", ms.detect},
                                                 {"retrieve", ms.retrieve},
                                                 {"filter", ms.filter},
                                                 {"verify", ms.verify}};
          },
          "What each stage took.")
      .def("__repr__", [](const Localization& l) {
        return l.pose ? fmt::format("<airslam.Location: {} inliers>", l.pose->inliers)
                      : fmt::format("<airslam.Location: refused: {}>", l.refusal);
      });
}

}  // namespace

void BindLocalization(nb::module_& module) {
  BindLocation(module);
  nb::class_<MapLocalizer>(
      module, "Localizer",
      "Finds where single images were taken in a finished map, from the image alone.")
      .def(
          nb::init<const fs::path&, const RigCamera&, const Config&, const fs::path&,
                   const std::optional<int>&, const std::optional<bool>&>(),
          "map"_a, "camera"_a, nb::kw_only(), "config"_a.none() = nb::none(),
          "model"_a = kDefaultModelPack, "candidates"_a = nb::none(),
          "structure_graph"_a = nb::none(), nb::call_guard<nb::gil_scoped_release>(),
          "map: a map file, best a refined one, or the folder of a run. camera: that takes the "
          "images. config: options of `airslam localize`, a YAML file or a dict of the same names "
          "(docs/options.md). model: model pack, a name or a folder. candidates: keyframes to "
          "match "
          "with (3), structure_graph: whether junctions choose them too (True); both go before the "
          "configuration. Raises Error.")
      .def(
          "localize",
          [](MapLocalizer& self, const GivenImage& image) {
            const cv::Mat pixels = AsMat(image);
            nb::gil_scoped_release release;
            return self.Localize(pixels);
          },
          "image"_a.noconvert(),
          "image: raw, uint8 height x width. Safe to call from several threads, which take turns. "
          "Raises "
          "Error on an image of another size than the camera's.");
}

}  // namespace airslam::python
