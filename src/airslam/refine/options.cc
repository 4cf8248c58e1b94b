// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/refine/options.h"

#include <sstream>

#include "airslam/common/options.h"
#include "airslam/refine/map_processor.h"

namespace airslam {
std::vector<std::string> RefineOptions::ProcessorNames() const {
  std::vector<std::string> names;
  std::istringstream list(processors);
  for (std::string name; std::getline(list, name, ',');) {
    const std::size_t begin = name.find_first_not_of(" \t");
    const std::size_t end = name.find_last_not_of(" \t");
    if (begin != std::string::npos) names.push_back(name.substr(begin, end - begin + 1));
  }
  return names;
}

void RefineOptions::Validate() const {
  RequireRanges(*this);
  for (const std::string& name : ProcessorNames()) MakeMapProcessor(name);
}

}  // namespace airslam
