// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <nanobind/nanobind.h>

#include <string>

namespace airslam::python {

// JSON text as a dict, list, str, int, float, bool or None.
inline nanobind::object ToPython(const std::string& json) {
  return nanobind::module_::import_("json").attr("loads")(json);
}

}  // namespace airslam::python
