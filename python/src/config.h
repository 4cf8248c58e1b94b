// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/string.h>

#include <cstdint>
#include <exception>
#include <filesystem>
#include <string>
#include <variant>

#include "airslam/common/options.h"

namespace airslam::python {

// Options as Python gives them: none, a YAML file, or a dict as JSON text.
struct Config {
  struct Dict {
    std::string json;
  };
  std::variant<std::monostate, std::filesystem::path, Dict> given;

  // Sets the fields that it names and validates the whole. Throws Error with the program's
  // sentence.
  template <class Options>
  void Load(Options& options) const {
    if (const auto* file = std::get_if<std::filesystem::path>(&given)) LoadOptions(*file, options);
    if (const auto* dict = std::get_if<Dict>(&given)) {
      LoadOptionsText(dict->json, "config", options);
    }
  }
};

}  // namespace airslam::python

namespace nanobind::detail {

// A dict holds what the YAML file would: names of options and groups. Values that JSON does not
// know (numpy's) are taken as what they hold.
template <>
struct type_caster<airslam::python::Config> {
  NB_TYPE_CASTER(airslam::python::Config, const_name("str | os.PathLike | dict | None"))

  bool from_python(handle source, std::uint32_t flags, cleanup_list* cleanup) noexcept {
    value = {};
    if (source.is_none()) return true;
    if (!isinstance<dict>(source)) {
      make_caster<std::filesystem::path> path;
      if (!path.from_python(source, flags, cleanup)) return false;
      value.given = path.value;
      return true;
    }
    try {
      value.given = airslam::python::Config::Dict{Json(source)};
      return true;
    } catch (const std::exception&) {  // keys that are no text, a dict within itself
      PyErr_Clear();
      return false;
    }
  }

  static std::string Json(handle source) {
    const object plain = cpp_function([](const object& v) -> object {
      return hasattr(v, "tolist") ? v.attr("tolist")() : object(str(v));
    });
    return cast<std::string>(module_::import_("json").attr("dumps")(
        source, arg("ensure_ascii") = false, arg("default") = plain));
  }
};

}  // namespace nanobind::detail
