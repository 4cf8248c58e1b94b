// SPDX-License-Identifier: BSD-3-Clause
//
// Options are plain structs with defaults that name their fields once and check themselves:
//
//   struct TrackingOptions {
//     int max_keypoints = 350;        // best scores kept a frame, 1..4096
//     double parallax_ratio = 0.1;    // of sqrt(width * height), > 0
//     template <class V> void Visit(V& v) {
//       v.Field("max_keypoints", max_keypoints);
//       v.Field("parallax_ratio", parallax_ratio);
//     }
//     void Validate() const {
//       RequireOption(max_keypoints > 0, "max_keypoints", max_keypoints, "must be at least 1");
//     }
//   };
//   struct MapOptions {
//     TrackingOptions tracking;
//     template <class V> void Visit(V& v) { v.Group("tracking", tracking); }
//     void Validate() const { tracking.Validate(); }
//   };
#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "airslam/common/error.h"

namespace airslam {

// One field of an option struct: its full name ("tracking.max_keypoints") and where its value lies.
struct OptionBinding {
  std::string name;
  std::variant<bool*, int*, float*, double*, std::string*> value;
};

// The visitor that collects an option struct's fields, in the order in which it names them.
class OptionCollector {
 public:
  template <class T>
  void Field(std::string_view name, T& value) {
    bindings_.push_back({prefix_ + std::string(name), &value});
  }

  template <class Options>
  void Group(std::string_view name, Options& options) {
    const std::string outer = prefix_;
    prefix_ += std::string(name) + '.';
    options.Visit(*this);
    prefix_ = outer;
  }

  std::vector<OptionBinding> Take() && { return std::move(bindings_); }

 private:
  std::string prefix_;
  std::vector<OptionBinding> bindings_;
};

template <class Options>
std::vector<OptionBinding> CollectOptions(Options& options) {
  OptionCollector collector;
  options.Visit(collector);
  return std::move(collector).Take();
}

// For Validate(): throws an Error such as "max_keypoints = -3 must be at least 1".
template <class T>
void RequireOption(bool holds, std::string_view name, const T& value, std::string_view rule) {
  if (!holds) Fail("{} = {} {}", name, value, rule);
}

// Sets the fields that the YAML file names and leaves the others. Throws Error with "file:line:"
// when the file cannot be read or parsed, a key is unknown (naming the nearest known one) or given
// twice, or a value has the wrong type (naming the field and what was expected).
void ReadOptions(const std::filesystem::path& yaml_file, std::span<const OptionBinding> bindings);

// YAML text of all fields; ReadOptions of it gives the same values, bit for bit.
std::string WriteOptions(std::span<const OptionBinding> bindings);

// ReadOptions, then options.Validate(), whose Error is preceded by the file's name.
template <class Options>
void LoadOptions(const std::filesystem::path& yaml_file, Options& options) {
  ReadOptions(yaml_file, CollectOptions(options));
  try {
    options.Validate();
  } catch (const Error& error) {
    Fail("{}: {}", yaml_file.string(), error.what());
  }
}

// The effective values as YAML text, for reports and logs.
template <class Options>
std::string DumpOptions(Options options) {
  return WriteOptions(CollectOptions(options));
}

}  // namespace airslam
