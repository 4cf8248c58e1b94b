// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <nanobind/nanobind.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "airslam/common/error.h"
#include "airslam/map/export_map.h"
#include "airslam/refine/refine_map_files.h"
#include "src/bindings.h"
#include "src/config.h"
#include "src/json.h"

namespace airslam::python {
namespace {

namespace fs = std::filesystem;
namespace nb = nanobind;
using nb::literals::operator""_a;
using OptionalPath = std::optional<fs::path>;

// Ends the refinement when Python has received a signal (Ctrl-C), and tells `on_progress`.
RefineObserver ObserverFor(const nb::object& on_progress) {
  return [&on_progress](const RefineProgress& progress) {
    const nb::gil_scoped_acquire acquire;
    if (PyErr_CheckSignals() != 0) throw nb::python_error();
    if (on_progress.is_none()) return;
    on_progress(std::string(progress.processor), progress.done, progress.total,
                std::string(progress.state));
  };
}

nb::object RefineFiles(std::vector<fs::path> maps, const fs::path& out, const Config& config,
                       const OptionalPath& model, const OptionalPath& report,
                       const nb::object& on_progress) {
  std::string text;
  {
    const nb::gil_scoped_release release;
    RefineRequest request{std::move(maps), out};
    config.Load(request.options);
    request.model_pack = model.value_or(fs::path()).string();
    request.report = report.value_or(fs::path());
    text = RefineMapFiles(request, ObserverFor(on_progress)).report.dump();
  }
  return ToPython(text);
}

nb::object Refine(const fs::path& map, const fs::path& out, const Config& config,
                  const OptionalPath& model, const OptionalPath& report,
                  const nb::object& on_progress) {
  return RefineFiles({map}, out, config, model, report, on_progress);
}

nb::object Merge(const std::vector<fs::path>& maps, const fs::path& out, const Config& config,
                 const OptionalPath& model, const OptionalPath& report,
                 const nb::object& on_progress) {
  if (maps.size() < 2) Fail("merging needs two maps at least, not {}", maps.size());
  return RefineFiles(maps, out, config, model, report, on_progress);
}

int Export(const fs::path& map, const OptionalPath& tum, const OptionalPath& ply,
           const OptionalPath& colmap, const std::optional<int>& component) {
  return ExportMap({map, tum.value_or(fs::path()), ply.value_or(fs::path()),
                    colmap.value_or(fs::path()), component});
}

}  // namespace

void BindRefinement(nb::module_& module) {
  module.def(
      "refine", &Refine, "map"_a, "out"_a, nb::kw_only(), "config"_a.none() = nb::none(),
      "model"_a = nb::none(), "report"_a = nb::none(), "on_progress"_a = nb::none(),
      nb::sig("def refine(map: str | os.PathLike, out: str | os.PathLike, *, config: str | "
              "os.PathLike | dict | None = None, model: str | os.PathLike | None = None, report: "
              "str | os.PathLike | None = None, on_progress: collections.abc.Callable[[str, int, "
              "int, str], object] | None = None) -> dict"),
      "Optimizes a map (loops, merging, pose graph, bundle adjustment) and readies it for "
      "localization, as `airslam refine` does, bit for bit.\n\n"
      "map: a map file or the folder of a run; it is only read. out: the map file to write; an "
      "earlier one is replaced as a whole. config: options, a YAML file or a dict of the same "
      "names (docs/options.md). model: model pack, a name or a folder; the one that the map names "
      "if not given. report: JSON file of what was done, beside it a picture of the loops. "
      "on_progress: called with the processor's name, how many of how many steps are done, and a "
      "word or two; what it raises ends the work, as Ctrl-C does, and leaves no result. Returns "
      "the report as a dict (docs/refine.md). Raises Error.");
  module.def(
      "merge", &Merge, "maps"_a, "out"_a, nb::kw_only(), "config"_a.none() = nb::none(),
      "model"_a = nb::none(), "report"_a = nb::none(), "on_progress"_a = nb::none(),
      nb::sig("def merge(maps: collections.abc.Sequence[str | os.PathLike], out: str | "
              "os.PathLike, *, config: str | os.PathLike | dict | None = None, model: str | "
              "os.PathLike | None = None, report: str | os.PathLike | None = None, on_progress: "
              "collections.abc.Callable[[str, int, int, str], object] | None = None) -> dict"),
      "Joins maps of several sessions at the same place and refines the whole, as `airslam merge` "
      "does, bit for bit.\n\n"
      "maps: two or more, of which the first one's world stays. The rest as of refine. Raises "
      "Error when a session is not found again.");
  module.def(
      "export", &Export, "map"_a, nb::kw_only(), "tum"_a = nb::none(), "ply"_a = nb::none(),
      "colmap"_a = nb::none(), "component"_a = nb::none(), nb::call_guard<nb::gil_scoped_release>(),
      "Writes one component of a map in formats of other programs, as `airslam export` does.\n\n"
      "map: a map file or the folder of a run. tum: file of the keyframes' poses, world from body. "
      "ply: file of points, lines and path. colmap: folder of a COLMAP model in text form. "
      "component: the largest if not given. Returns the component. Raises Error.");
}

}  // namespace airslam::python
