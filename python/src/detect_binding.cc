// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <nanobind/nanobind.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <filesystem>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "airslam/neural/detect_image.h"
#include "airslam/neural/model_pack.h"
#include "airslam/neural/plnet.h"
#include "src/arrays.h"
#include "src/bindings.h"
#include "src/images.h"

namespace airslam::python {
namespace {

namespace fs = std::filesystem;
using nb::literals::operator""_a;

// The network of a pack, for one image after the other.
class ImageDetector {
 public:
  explicit ImageDetector(const fs::path& model)
      : pack_(LoadModelPack(model.string())), network_(pack_.features) {}

  // From any thread, one after the other. mask may be empty.
  Detections Detect(const cv::Mat& image, const cv::Mat& mask, const ImageRequest& request) {
    const std::lock_guard lock(mutex_);
    return DetectImage(image, mask, request, network_);
  }

  const std::string& name() const { return pack_.name; }
  bool finds_lines() const { return network_.finds_lines(); }
  int descriptor_size() const { return network_.descriptor_size(); }

 private:
  const ModelPack pack_;
  PlNet network_;
  std::mutex mutex_;
};

using Points = Array<float, -1, 3>;

Points WithScores(const std::vector<Keypoint>& keypoints) {
  std::vector<float> numbers;
  for (const Keypoint& p : keypoints) numbers.insert(numbers.end(), {p.x, p.y, p.score});
  return ToArray<Points>(std::move(numbers), {keypoints.size(), 3});
}

Array<float, -1, 5> Lines(const Detections& found) {
  std::vector<float> numbers;
  for (const LineSegment& l : found.lines) {
    numbers.insert(numbers.end(), {l.x1, l.y1, l.x2, l.y2, l.score});
  }
  return ToArray<Array<float, -1, 5>>(std::move(numbers), {found.lines.size(), 5});
}

Array<std::int64_t, -1, 2> Ends(const Detections& found) {
  std::vector<std::int64_t> rows;
  for (const LineEnds& ends : found.line_ends) rows.insert(rows.end(), {ends.start, ends.end});
  return ToArray<Array<std::int64_t, -1, 2>>(std::move(rows), {found.line_ends.size(), 2});
}

void BindDetections(nb::module_& module) {
  nb::class_<Detections>(module, "Detections",
                         "What the network sees in an image. Every access makes a new array. "
                         "Pixels are those of the image.")
      .def_prop_ro(
          "keypoints", [](const Detections& d) { return WithScores(d.keypoints); },
          "N x 3 float32: x, y, score; best first.", nb::rv_policy::automatic)
      .def_prop_ro(
          "descriptors", [](const Detections& d) { return Rows(d.descriptors); },
          "N x D float32, rows of unit length.", nb::rv_policy::automatic)
      .def_prop_ro("lines", &Lines,
                   "M x 5 float32: x1, y1, x2, y2, score (the probability that it is a line); best "
                   "first.",
                   nb::rv_policy::automatic)
      .def_prop_ro("line_ends", &Ends,
                   "M x 2 int64: the rows of junctions that are a line's two ends.",
                   nb::rv_policy::automatic)
      .def_prop_ro(
          "junctions", [](const Detections& d) { return WithScores(d.junctions); },
          "J x 3 float32: x, y, score of the ends of the lines.", nb::rv_policy::automatic)
      .def_prop_ro(
          "junction_descriptors", [](const Detections& d) { return Rows(d.junction_descriptors); },
          "J x D float32, rows of unit length.", nb::rv_policy::automatic)
      .def("__repr__", [](const Detections& d) {
        return fmt::format("<airslam.Detections: {} keypoints, {} lines>", d.keypoints.size(),
                           d.lines.size());
      });
}

}  // namespace

void BindDetection(nb::module_& module) {
  BindDetections(module);
  nb::class_<ImageDetector>(module, "Detector", "Finds keypoints and lines in single images.")
      .def(nb::init<const fs::path&>(), "model"_a = kDefaultModelPack,
           nb::call_guard<nb::gil_scoped_release>(),
           "model: model pack, a name or a folder. Raises Error.")
      .def(
          "detect",
          [](ImageDetector& self, const GivenImage& image, bool lines, int max_keypoints,
             float min_line_score, float line_scale, const std::optional<GivenImage>& mask) {
            const cv::Mat pixels = AsMat(image), where = mask ? AsMat(*mask) : cv::Mat();
            const nb::gil_scoped_release release;
            return self.Detect(pixels, where, {max_keypoints, lines, min_line_score, line_scale});
          },
          "image"_a.noconvert(), nb::kw_only(), "lines"_a = ImageRequest().lines,
          "max_keypoints"_a = ImageRequest().max_keypoints,
          "min_line_score"_a = ImageRequest().min_line_score,
          "line_scale"_a = ImageRequest().line_scale, "mask"_a.noconvert() = nb::none(),
          "As `airslam detect` does, the same numbers.\n\n"
          "image: uint8 height x width, of any size. lines: whether lines and junctions are looked "
          "for; takes longer. max_keypoints: so many of the best. min_line_score: lines of a lower "
          "score are left out; at 0 all proposals come, at 0.4 most are lines. line_scale: lines "
          "are looked for in the image enlarged by so much, up to a shorter side of 720 pixels; at "
          "1 in the pass that finds the keypoints, as mapping does. mask: uint8 of the same size, "
          "features only where it is not 0. Safe to call from several threads, which take turns. "
          "The first image of a size takes longer: the network is prepared for it. Raises Error.")
      .def_prop_ro("model", &ImageDetector::name, "Name of the model pack.")
      .def_prop_ro("finds_lines", &ImageDetector::finds_lines,
                   "Whether the pack's network finds lines; else there are none.")
      .def_prop_ro("descriptor_size", &ImageDetector::descriptor_size,
                   "D, the length of a descriptor.");
}

}  // namespace airslam::python
