// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "airslam/refine/options.h"
#include "airslam/refine/refine.h"

namespace airslam {

// What is asked of refining, or of joining and refining, map files.
struct RefineRequest {
  // At least one: map files, or folders of runs. The first one's world stays; the keyframes of the
  // others are found again in what is there already. They are only read.
  std::vector<std::filesystem::path> maps;
  std::filesystem::path out;  // map file; an earlier one is replaced as a whole
  RefineOptions options = {};
  std::string model_pack = {};  // a name or a folder; empty: the pack that the map names
  // JSON file of what was done (docs/refine.md), with a picture of the loops beside it; empty:
  // none.
  std::filesystem::path report = {};
};

// Reads the maps, joins them, runs the map processors and writes the result: what `airslam refine`,
// `airslam merge` and Python's refine and merge do. Returns what RefineMap returns; its report also
// names the files. Throws Error, leaving `out` as it was, when a map cannot be read or was made
// with other weights than the pack's, the maps do not fit together, `out` is one of them or cannot
// be written, or a session is not found again in the first one.
RefineResult RefineMapFiles(const RefineRequest& request, const RefineObserver& observer = {});

}  // namespace airslam
