// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/common/options.h"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <set>
#include <sstream>
#include <type_traits>

namespace airslam {
namespace {

// What sentences about options begin with: where they stand.
struct Source {
  std::string name;       // a file, or what stands in for one
  bool has_lines = true;  // and its lines can be told

  std::string At(const YAML::Mark& mark) const {
    return mark.is_null() || !has_lines ? name : fmt::format("{}:{}", name, mark.line + 1);
  }
};

// Levenshtein distance: how many single letters to insert, delete or change.
int EditDistance(std::string_view a, std::string_view b) {
  std::vector<int> row(b.size() + 1);
  std::iota(row.begin(), row.end(), 0);
  for (std::size_t i = 0; i < a.size(); ++i) {
    int diagonal = row[0];
    row[0] = static_cast<int>(i) + 1;
    for (std::size_t j = 0; j < b.size(); ++j) {
      const int substituted = diagonal + (a[i] == b[j] ? 0 : 1);
      diagonal = row[j + 1];
      row[j + 1] = std::min({row[j] + 1, row[j + 1] + 1, substituted});
    }
  }
  return row.back();
}

// "a.b.c" -> {"a.b.", "c"}.
std::pair<std::string_view, std::string_view> SplitName(std::string_view name) {
  const std::size_t dot = name.rfind('.');
  if (dot == std::string_view::npos) return {{}, name};
  return {name.substr(0, dot + 1), name.substr(dot + 1)};
}

// Every name that may stand in the file: fields, and the groups that hold them.
std::vector<std::string> KnownNames(std::span<const OptionBinding> bindings) {
  std::vector<std::string> names;
  for (const OptionBinding& binding : bindings) {
    for (std::size_t dot = binding.name.find('.'); dot != std::string::npos;
         dot = binding.name.find('.', dot + 1)) {
      const std::string group = binding.name.substr(0, dot);
      if (std::find(names.begin(), names.end(), group) == names.end()) names.push_back(group);
    }
    names.push_back(binding.name);
  }
  return names;
}

// Compares last parts, so that a key in the wrong group finds its place too.
std::string NearestName(const std::string& name, std::span<const OptionBinding> bindings) {
  const auto [group, key] = SplitName(name);
  std::string nearest;
  int best = 0;
  for (const std::string& known : KnownNames(bindings)) {
    const auto [known_group, known_key] = SplitName(known);
    const int distance = 2 * EditDistance(key, known_key) + (group == known_group ? 0 : 1);
    if (nearest.empty() || distance < best) {
      nearest = known;
      best = distance;
    }
  }
  return nearest;
}

template <class T>
constexpr const char* kExpected = "text";
template <>
constexpr const char* kExpected<bool> = "true or false";
template <>
constexpr const char* kExpected<int> = "a whole number";
template <>
constexpr const char* kExpected<float> = "a number";
template <>
constexpr const char* kExpected<double> = "a number";

template <class T>
std::optional<T> Parse(const YAML::Node& node) {
  T value;
  if (!node.IsScalar() || !YAML::convert<T>::decode(node, value)) return std::nullopt;
  if constexpr (std::is_floating_point_v<T>) {
    if (!std::isfinite(value)) return std::nullopt;
  }
  return value;
}

class Reader {
 public:
  Reader(Source source, std::span<const OptionBinding> bindings)
      : source_(std::move(source)), bindings_(bindings) {}

  // `load` makes the text's root; Error when it is no valid YAML.
  template <class Load>
  void Read(Load&& load) {
    YAML::Node root;
    try {
      root = load();
    } catch (const YAML::ParserException& error) {
      Fail("{}: not valid YAML: {}", source_.At(error.mark), error.msg);
    }
    if (root.IsNull()) return;
    if (!root.IsMap()) Fail("{}: a configuration must hold 'name: value' lines", source_.name);
    ReadMap(root, "");
  }

 private:
  void ReadMap(const YAML::Node& map, const std::string& prefix) {
    for (const auto& entry : map) {
      const std::string name = prefix + entry.first.Scalar();
      if (!seen_.insert(name).second) {
        Fail("{}: option '{}' is given twice", source_.At(entry.first.Mark()), name);
      }
      ReadEntry(entry.first, entry.second, name);
    }
  }

  void ReadEntry(const YAML::Node& key, const YAML::Node& value, const std::string& name) {
    for (const OptionBinding& binding : bindings_) {
      if (binding.name == name) return ReadField(value, binding);
    }
    const std::string prefix = name + '.';
    const bool is_group = std::any_of(bindings_.begin(), bindings_.end(), [&](const auto& binding) {
      return binding.name.starts_with(prefix);
    });
    if (!is_group) {
      Fail("{}: unknown option '{}'; the nearest known one is '{}'", source_.At(key.Mark()), name,
           NearestName(name, bindings_));
    }
    if (value.IsNull()) return;
    if (!value.IsMap()) {
      Fail("{}: '{}' is a group of options and must hold 'name: value' lines",
           source_.At(value.Mark()), name);
    }
    ReadMap(value, prefix);
  }

  void ReadField(const YAML::Node& node, const OptionBinding& binding) {
    std::visit(
        [&]<class T>(T* target) {
          const std::optional<T> value = Parse<T>(node);
          if (!value) {
            Fail("{}: option '{}' must be {}, but is '{}'", source_.At(node.Mark()), binding.name,
                 kExpected<T>, node.IsScalar() ? node.Scalar() : YAML::Dump(node));
          }
          *target = *value;
        },
        binding.value);
  }

  Source source_;
  std::span<const OptionBinding> bindings_;
  std::set<std::string> seen_;
};

std::string ScalarText(const OptionBinding& binding) {
  return std::visit(
      []<class T>(T* value) -> std::string {
        if constexpr (std::is_same_v<T, std::string>) {
          YAML::Emitter emitter;
          emitter << YAML::DoubleQuoted << *value;
          return emitter.c_str();
        } else {
          return fmt::format("{}", *value);  // floating point: the shortest text that reads back
        }
      },
      binding.value);
}

// "0.001 to 1 image widths", "true or false", "text".
std::string RangeText(const OptionBinding& binding) {
  if (std::holds_alternative<bool*>(binding.value)) return "true or false";
  if (std::holds_alternative<std::string*>(binding.value)) return "text";
  const OptionRange& range = binding.range;
  return fmt::format("{} to {}{}{}", range.low, range.high, range.unit.empty() ? "" : " ",
                     range.unit);
}

// A comment of lines that are at most 100 columns long.
std::string Comment(const std::string& text, int indent) {
  const std::string start = fmt::format("{:{}}#", "", indent);
  std::string comment, line = start;
  std::istringstream words(text);
  for (std::string word; words >> word;) {
    if (line.size() + 1 + word.size() > 100) {
      comment += line + '\n';
      line = start;
    }
    line += ' ' + word;
  }
  return comment + line + '\n';
}

std::string WriteYaml(std::span<const OptionBinding> bindings, bool with_comments) {
  std::string text;
  std::string open_group;  // as "a.b."
  for (const OptionBinding& binding : bindings) {
    const auto [group, key] = SplitName(binding.name);
    // Name the groups that this field opens; those it shares with the one before stand already.
    std::size_t begin = 0;
    int depth = 0;
    for (std::size_t dot = group.find('.'); dot != std::string_view::npos;
         dot = group.find('.', begin), ++depth) {
      if (!open_group.starts_with(group.substr(0, dot + 1))) {
        if (with_comments) text += '\n' + Comment(std::string(binding.group_words), 2 * depth);
        text += fmt::format("{:{}}{}:\n", "", 2 * depth, group.substr(begin, dot - begin));
      }
      begin = dot + 1;
    }
    open_group = group;
    if (with_comments) {
      text += Comment(fmt::format("{} ({})", binding.words, RangeText(binding)), 2 * depth);
    }
    text += fmt::format("{:{}}{}: {}\n", "", 2 * depth, key, ScalarText(binding));
  }
  return text;
}

}  // namespace

void ReadOptions(const std::filesystem::path& yaml_file, std::span<const OptionBinding> bindings) {
  const std::string file = yaml_file.string();
  Reader({file}, bindings).Read([&] {
    try {
      return YAML::LoadFile(file);
    } catch (const YAML::BadFile&) {
      Fail("{}: the configuration file cannot be read", file);
    }
  });
}

void ReadOptionsText(const std::string& yaml, const std::string& name,
                     std::span<const OptionBinding> bindings) {
  Reader({name, false}, bindings).Read([&] { return YAML::Load(yaml); });
}

void RequireRanges(std::span<const OptionBinding> bindings) {
  for (const OptionBinding& binding : bindings) {
    std::visit(
        [&]<class T>(T* value) {
          if constexpr (!std::is_same_v<T, bool> && !std::is_same_v<T, std::string>) {
            const auto number = static_cast<double>(*value);
            if (!(number >= binding.range.low && number <= binding.range.high)) {
              Fail("option {} is {}, which is not in the range {}", binding.name, *value,
                   RangeText(binding));
            }
          }
        },
        binding.value);
  }
}

std::string WriteOptions(std::span<const OptionBinding> bindings) {
  return WriteYaml(bindings, false);
}

std::string DescribeOptions(std::span<const OptionBinding> bindings) {
  return WriteYaml(bindings, true);
}

std::string TabulateOptions(std::span<const OptionBinding> bindings) {
  std::string text;
  std::optional<std::string_view> open_group;
  for (const OptionBinding& binding : bindings) {
    const auto [group, key] = SplitName(binding.name);
    if (open_group != group) {
      if (!group.empty()) {
        text += fmt::format("\n### {}\n\n{}\n\n", group.substr(0, group.size() - 1),
                            binding.group_words);
      }
      text += "| option | default | range, unit | meaning |\n|---|---|---|---|\n";
      open_group = group;
    }
    text += fmt::format("| `{}` | `{}` | {} | {} |\n", key, ScalarText(binding), RangeText(binding),
                        binding.words);
  }
  return text;
}

}  // namespace airslam
