// SPDX-License-Identifier: BSD-3-Clause
//
// Options are plain structs with defaults that name their fields once: name, range, unit and
// meaning. Reading and checking a configuration file, `airslam options` and docs/options.md all
// come from there.
//
//   struct TrackingOptions {
//     int max_keypoints = 350;
//     double parallax = 0.1;
//     template <class V> void Visit(V& v) {
//       v.Field("max_keypoints", max_keypoints, {1, 4096}, "Best scores kept in a frame.");
//       v.Field("parallax", parallax, {0.001, 10, "sqrt(width * height)"}, "Above it: a
//       keyframe.");
//     }
//   };
//   struct MapOptions {
//     TrackingOptions tracking;
//     template <class V> void Visit(V& v) { v.Group("tracking", tracking, "How frames match."); }
//     void Validate() const { RequireRanges(*this); }
//   };
#pragma once

#include <filesystem>
#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "airslam/common/error.h"

namespace airslam {

// What a number may be, both ends included, and in which unit it is; no unit: a count or a ratio.
struct OptionRange {
  double low = -std::numeric_limits<double>::infinity();
  double high = std::numeric_limits<double>::infinity();
  std::string_view unit = {};
};

// One field of an option struct: its full name ("tracking.max_keypoints"), where its value lies and
// what it means.
struct OptionBinding {
  std::string name;
  std::variant<bool*, int*, float*, double*, std::string*> value;
  OptionRange range;
  std::string_view words;
  std::string_view group_words;  // about the group that holds it
};

// The visitor that collects an option struct's fields, in the order in which it names them. Texts
// are string literals.
class OptionCollector {
 public:
  // A number.
  template <class T>
  void Field(std::string_view name, T& value, const OptionRange& range, std::string_view words) {
    bindings_.push_back({prefix_ + std::string(name), &value, range, words, group_words_});
  }
  // Text, or true or false.
  template <class T>
  void Field(std::string_view name, T& value, std::string_view words) {
    bindings_.push_back({prefix_ + std::string(name), &value, {}, words, group_words_});
  }

  template <class Options>
  void Group(std::string_view name, Options& options, std::string_view words) {
    const std::string outer = prefix_;
    const std::string_view outer_words = std::exchange(group_words_, words);
    prefix_ += std::string(name) + '.';
    options.Visit(*this);
    prefix_ = outer;
    group_words_ = outer_words;
  }

  std::vector<OptionBinding> Take() && { return std::move(bindings_); }

 private:
  std::string prefix_;
  std::string_view group_words_;
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

// Throws Error that names the first field out of its range.
void RequireRanges(std::span<const OptionBinding> bindings);

template <class Options>
void RequireRanges(Options options) {
  RequireRanges(std::span<const OptionBinding>(CollectOptions(options)));
}

// Sets the fields that the YAML file names and leaves the others. Throws Error with "file:line:"
// when the file cannot be read or parsed, a key is unknown (naming the nearest known one) or given
// twice, or a value has the wrong type (naming the field and what was expected).
void ReadOptions(const std::filesystem::path& yaml_file, std::span<const OptionBinding> bindings);

// The same from YAML text on one line (JSON is such text) that stands in no file: `name` takes the
// place of "file:line" in the sentences.
void ReadOptionsText(const std::string& yaml, const std::string& name,
                     std::span<const OptionBinding> bindings);

// YAML text of all fields; ReadOptions of it gives the same values, bit for bit.
std::string WriteOptions(std::span<const OptionBinding> bindings);

// The same with unit, range and meaning of each field as comments: a file to start from.
std::string DescribeOptions(std::span<const OptionBinding> bindings);

// The same as Markdown tables, one a group.
std::string TabulateOptions(std::span<const OptionBinding> bindings);

// options.Validate(), whose Error is preceded by `name`.
template <class Options>
void ValidateOptions(const std::string& name, const Options& options) {
  try {
    options.Validate();
  } catch (const Error& error) {
    Fail("{}: {}", name, error.what());
  }
}

// ReadOptions, then ValidateOptions with the file's name.
template <class Options>
void LoadOptions(const std::filesystem::path& yaml_file, Options& options) {
  ReadOptions(yaml_file, CollectOptions(options));
  ValidateOptions(yaml_file.string(), options);
}

// ReadOptionsText, then ValidateOptions.
template <class Options>
void LoadOptionsText(const std::string& yaml, const std::string& name, Options& options) {
  ReadOptionsText(yaml, name, CollectOptions(options));
  ValidateOptions(name, options);
}

// The effective values as YAML text, for reports and logs.
template <class Options>
std::string DumpOptions(Options options) {
  return WriteOptions(CollectOptions(options));
}

}  // namespace airslam
