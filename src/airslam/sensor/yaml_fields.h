// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <yaml-cpp/yaml.h>

#include <filesystem>
#include <string>
#include <vector>

#include "airslam/geometry/rigid3.h"

namespace airslam {

// A part of a YAML file whose accessors throw an Error that names the file and the field.
class YamlFields {
 public:
  // Reads and parses the file. A first line `%YAML:1.0`, which OpenCV writes and no YAML parser
  // accepts, is skipped.
  static YamlFields Load(const std::filesystem::path& file);

  bool Has(const std::string& field) const;
  // The map below `field`, which must exist.
  YamlFields Sub(const std::string& field) const;
  double Number(const std::string& field) const;
  double NumberOr(const std::string& field, double otherwise) const;
  std::string Text(const std::string& field) const;
  // A flat list of numbers; `count` of them, or any number when `count` is negative.
  std::vector<double> Numbers(const std::string& field, int count) const;
  // A rigid transform: 16 numbers row by row in `data` below the field (EuRoC), or a list of four
  // rows (Kalibr). The rotation must be one to about 1e-3.
  Rigid3 Transform(const std::string& field) const;

  // "file.yaml" or "cam0 of file.yaml", for messages.
  const std::string& where() const { return where_; }

 private:
  YamlFields(YAML::Node node, std::string where) : node_(node), where_(std::move(where)) {}
  YAML::Node Required(const std::string& field) const;

  YAML::Node node_;
  std::string where_;
};

}  // namespace airslam
