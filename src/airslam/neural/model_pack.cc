// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/neural/model_pack.h"

#include <dlfcn.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <system_error>
#include <vector>

#include "airslam/common/error.h"
#include "airslam/common/sha256.h"

namespace airslam {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr int kFormat = 2;

// One object of the manifest, with what error messages need to name its fields.
class Section {
 public:
  Section(const json& object, std::string file, std::string prefix)
      : object_(object), file_(std::move(file)), prefix_(std::move(prefix)) {
    if (!object_.is_object()) Fail("{}: '{}' is not an object", file_, prefix_);
  }

  std::string Name(const std::string& key) const {
    return prefix_.empty() ? key : prefix_ + "." + key;
  }

  bool Has(const std::string& key) const { return object_.contains(key); }

  const json& At(const std::string& key) const {
    const auto value = object_.find(key);
    if (value == object_.end()) Fail("{}: the field '{}' is missing", file_, Name(key));
    return *value;
  }

  std::string Text(const std::string& key) const {
    const json& value = At(key);
    if (!value.is_string() || value.get_ref<const std::string&>().empty()) {
      Fail("{}: '{}' is {}, expected a text", file_, Name(key), value.dump());
    }
    return value.get<std::string>();
  }

  bool Flag(const std::string& key) const {
    const json& value = At(key);
    if (!value.is_boolean()) {
      Fail("{}: '{}' is {}, expected true or false", file_, Name(key), value.dump());
    }
    return value.get<bool>();
  }

  int Integer(const std::string& key, int low, int high) const {
    const json& value = At(key);
    if (!value.is_number_integer() || value.get<double>() < low || value.get<double>() > high) {
      Fail("{}: '{}' is {}, expected an integer from {} to {}", file_, Name(key), value.dump(), low,
           high);
    }
    return value.get<int>();
  }

  float Number(const std::string& key, double low, double high) const {
    const json& value = At(key);
    if (!value.is_number() || value.get<double>() < low || value.get<double>() > high) {
      Fail("{}: '{}' is {}, expected a number from {} to {}", file_, Name(key), value.dump(), low,
           high);
    }
    return value.get<float>();
  }

  // A list of numbers; empty where there is none of that name.
  std::vector<float> Numbers(const std::string& key, double low, double high) const {
    if (!object_.contains(key)) return {};
    const json& values = object_.at(key);
    const auto wrong = [&](const json& value) {
      return !value.is_number() || value.get<double>() < low || value.get<double>() > high;
    };
    if (!values.is_array() || values.size() > 1024 ||
        std::any_of(values.begin(), values.end(), wrong)) {
      Fail("{}: '{}' is not a list of at most 1024 numbers from {} to {}", file_, Name(key), low,
           high);
    }
    return values.get<std::vector<float>>();
  }

  Section Sub(const std::string& key) const { return Section(At(key), file_, Name(key)); }

  // A number of pixels that divides `multiple`.
  int Divisor(const std::string& key, int multiple) const {
    const int value = Integer(key, 1, 64);
    if (multiple % value != 0) {
      Fail("{}: '{}' is {}, expected a divisor of features.multiple, {}", file_, Name(key), value,
           multiple);
    }
    return value;
  }

  // The objects of a list that is not empty.
  std::vector<Section> List(const std::string& key) const {
    const json& values = At(key);
    if (!values.is_array() || values.empty()) {
      Fail("{}: '{}' is not a list of at least one object", file_, Name(key));
    }
    std::vector<Section> sections;
    for (std::size_t i = 0; i < values.size(); ++i) {
      sections.emplace_back(values[i], file_, fmt::format("{}[{}]", Name(key), i));
    }
    return sections;
  }

  const std::string& file() const { return file_; }

 private:
  const json& object_;
  std::string file_;
  std::string prefix_;
};

// The file that a section names, after comparing its hash.
PackFile CheckedFile(const Section& section, const fs::path& folder) {
  const std::string name = section.Text("file");
  if (fs::path(name).filename() != name || name == "." || name == "..") {
    Fail("{}: '{}' is \"{}\", expected a plain file name", section.file(), section.Name("file"),
         name);
  }
  PackFile file;
  file.path = (folder / name).string();
  file.sha256 = section.Text("sha256");
  std::error_code error;
  if (!fs::is_regular_file(file.path, error)) {
    Fail("{}: no such file, but {} names it: the model pack is incomplete", file.path,
         section.file());
  }
  const std::string found = FileSha256(file.path);
  if (found != file.sha256) {
    Fail("{}: its SHA-256 is {}, but {} states {}: the file is damaged or of another version",
         file.path, found, section.file(), file.sha256);
  }
  return file;
}

RowNetworkSpec ReadRowNetwork(const Section& section, const fs::path& folder) {
  return {CheckedFile(section, folder), section.Text("input"), section.Text("output")};
}

FeatureMapSpec ReadMap(const Section& section, int multiple) {
  FeatureMapSpec map;
  map.output = section.Text("output");
  map.channels = section.Integer("channels", 1, 1024);
  map.stride = section.Divisor("stride", multiple);
  return map;
}

LineNetworkSpec ReadLines(const Section& section, const fs::path& folder, int multiple) {
  LineNetworkSpec spec;
  spec.network = CheckedFile(section, folder);
  spec.field = section.Text("field");
  spec.junctions = section.Text("junctions");
  for (const Section& pooled : section.List("pooled")) {
    spec.pooled.push_back({ReadMap(pooled, multiple), pooled.Integer("samples", 2, 1024),
                           pooled.Numbers("end_offsets", -1e4, 1e4)});
  }
  spec.classifier = ReadRowNetwork(section.Sub("classifier"), folder);
  spec.decoder.stride = section.Divisor("stride", multiple);
  spec.decoder.reach = section.Number("reach", 0.1, 1e4);
  spec.decoder.min_confidence = section.Number("min_confidence", 1e-6, 0.999);
  spec.decoder.min_junction = section.Number("min_junction", 1e-6, 0.999);
  spec.decoder.max_junctions = section.Integer("max_junctions", 2, 65535);
  spec.decoder.snap = section.Number("snap", 0.1, 1e4);
  spec.decoder.min_support = section.Number("min_support", 1e-6, 1);
  spec.decoder.double_radius = section.Number("double_radius", 0, 1e4);
  spec.decoder.overlap_radius = section.Number("overlap_radius", 0, 1e4);
  spec.decoder.max_proposals = section.Integer("max_proposals", 1, 65536);
  return spec;
}

MapLayout ReadLayout(const Section& section) {
  const std::string layout = section.Text("layout");
  if (layout != "cells" && layout != "planes") {
    Fail("{}: '{}' is \"{}\", expected \"cells\" or \"planes\"", section.file(),
         section.Name("layout"), layout);
  }
  return layout == "cells" ? MapLayout::kCells : MapLayout::kPlanes;
}

FeatureNetworkSpec ReadFeatures(const Section& section, const fs::path& folder) {
  FeatureNetworkSpec spec;
  spec.network = CheckedFile(section, folder);
  spec.input = section.Text("input");
  const std::string normalization = section.Text("normalization");
  if (normalization != "unit" && normalization != "standardize") {
    Fail("{}: '{}' is \"{}\", expected \"unit\" or \"standardize\"", section.file(),
         section.Name("normalization"), normalization);
  }
  spec.normalization = normalization == "unit" ? Normalization::kUnit : Normalization::kStandardize;
  spec.multiple = section.Integer("multiple", 1, 256);
  spec.scores = section.Text("scores");
  spec.score_stride = section.Divisor("score_stride", spec.multiple);
  spec.layout = ReadLayout(section);
  for (const Section& map : section.List("maps")) {
    spec.maps.push_back(ReadMap(map, spec.multiple));
  }
  spec.descriptor_size = section.Integer("descriptor_size", 1, 1024);
  if (section.Has("descriptor_head")) {
    spec.descriptor_head = ReadRowNetwork(section.Sub("descriptor_head"), folder);
  } else if (spec.maps.size() != 1 || spec.maps[0].channels != spec.descriptor_size) {
    Fail("{}: without '{}' descriptors are read of one map, of {} channels", section.file(),
         section.Name("descriptor_head"), spec.descriptor_size);
  }
  spec.half_pixel = section.Flag("half_pixel");
  spec.score_threshold = section.Number("score_threshold", -1e6, 1e6);
  spec.nms_radius = section.Integer("nms_radius", 1, 16);
  if (section.Has("lines")) {
    if (spec.layout != MapLayout::kCells) {
      Fail("{}: lines need the maps in the layout \"cells\"", section.file());
    }
    spec.lines = ReadLines(section.Sub("lines"), folder, spec.multiple);
  }
  return spec;
}

MatcherSpec ReadMatcher(const Section& section, const fs::path& folder) {
  MatcherSpec spec;
  spec.keypoints = section.Integer("keypoints", 1, 4096);
  spec.threshold = section.Number("threshold", 0, 1);
  spec.exit_confidence = section.Number("exit_confidence", 0, 1);
  for (const Section& stage : section.List("stages")) {
    spec.stages.push_back(CheckedFile(stage, folder));
  }
  return spec;
}

json ParseManifest(const fs::path& file) {
  std::ifstream stream(file);
  if (!stream) Fail("{}: cannot be read", file.string());
  try {
    return json::parse(stream);
  } catch (const json::exception& error) {
    Fail("{}: not valid JSON: {}", file.string(), error.what());
  }
}

// The file that holds this code: the program, or the module of a Python package.
fs::path OwnFile() {
  Dl_info info;
  if (dladdr(reinterpret_cast<void*>(&FindModelPack), &info) == 0) return {};
  std::error_code error;
  return fs::canonical(info.dli_fname, error);
}

// Where packs that are called by their name may lie.
std::vector<fs::path> PackFolders() {
  std::error_code error;
  const fs::path own = OwnFile();
  if (own.extension() == ".so") return {own.parent_path() / "models"};
  const fs::path program = fs::read_symlink("/proc/self/exe", error).parent_path();
  return {program / "../share/airslam/models", program / "../models", program / "../../models"};
}

}  // namespace

std::string FindModelPack(const std::string& name_or_path) {
  std::error_code error;
  if (fs::is_directory(name_or_path, error)) return name_or_path;
  std::string looked = "'" + name_or_path + "'";
  if (!name_or_path.empty() && name_or_path.find('/') == std::string::npos) {
    for (const fs::path& models : PackFolders()) {
      const fs::path folder = (models / name_or_path).lexically_normal();
      if (fs::is_directory(folder, error)) return folder.string();
      looked += ", '" + folder.string() + "'";
    }
  }
  Fail("no model pack '{}': there is no folder {}", name_or_path, looked);
}

ModelPack ReadModelPack(const std::string& folder) {
  std::error_code error;
  if (!fs::is_directory(folder, error)) Fail("{}: no such model pack folder", folder);
  const fs::path file = fs::path(folder) / "manifest.json";
  if (!fs::is_regular_file(file, error)) {
    Fail("{}: not a model pack: it holds no manifest.json", folder);
  }
  const json manifest = ParseManifest(file);
  if (!manifest.is_object()) Fail("{}: not a JSON object", file.string());
  const Section root(manifest, file.string(), "");
  const json& format = root.At("format");
  if (format != kFormat) {
    Fail("{}: format {} is unknown, this program reads format {}", file.string(), format.dump(),
         kFormat);
  }
  ModelPack pack;
  pack.name = root.Text("name");
  pack.license = root.Text("license");
  pack.folder = folder;
  pack.sha256 = FileSha256(file);
  pack.features = ReadFeatures(root.Sub("features"), folder);
  if (manifest.contains("matcher")) pack.matcher = ReadMatcher(root.Sub("matcher"), folder);
  if (root.Has("vocabulary")) pack.vocabulary = CheckedFile(root.Sub("vocabulary"), folder);
  return pack;
}

ModelPack LoadModelPack(const std::string& name_or_path) {
  return ReadModelPack(FindModelPack(name_or_path));
}

}  // namespace airslam
