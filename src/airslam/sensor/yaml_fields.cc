// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/sensor/yaml_fields.h"

#include <Eigen/LU>
#include <cmath>
#include <fstream>
#include <sstream>

#include "airslam/common/error.h"

namespace airslam {
namespace {

std::string ReadText(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  if (!stream || !std::filesystem::is_regular_file(file)) {
    Fail("the calibration file {} cannot be read", file.string());
  }
  std::ostringstream text;
  text << stream.rdbuf();
  return text.str();
}

double ToNumber(const YAML::Node& node, const std::string& where, const std::string& field) {
  double value = 0;
  if (!node.IsScalar() || !YAML::convert<double>::decode(node, value) || !std::isfinite(value)) {
    Fail("{}: the field {} holds something that is not a number", where, field);
  }
  return value;
}

// The numbers of nested lists, in order.
void Flatten(const YAML::Node& node, const std::string& where, const std::string& field,
             std::vector<double>* numbers) {
  if (!node.IsSequence()) {
    numbers->push_back(ToNumber(node, where, field));
    return;
  }
  for (const YAML::Node& element : node) Flatten(element, where, field, numbers);
}

}  // namespace

YamlFields YamlFields::Load(const std::filesystem::path& file) {
  std::string text = ReadText(file);
  if (text.starts_with("%YAML"))
    text.erase(0, text.find('\n'));  // the line's end stays: line numbers
  YAML::Node node;
  try {
    node = YAML::Load(text);
  } catch (const YAML::Exception& error) {
    Fail("{}:{}: not valid YAML: {}", file.string(), error.mark.line + 1, error.msg);
  }
  if (!node.IsMap()) Fail("{}: expected a YAML file of named fields", file.string());
  return {node, file.string()};
}

bool YamlFields::Has(const std::string& field) const {
  const YAML::Node child = node_[field];
  return child && !child.IsNull();
}

YAML::Node YamlFields::Required(const std::string& field) const {
  if (!Has(field)) Fail("{}: the field {} is missing", where_, field);
  return node_[field];
}

YamlFields YamlFields::Sub(const std::string& field) const {
  const YAML::Node child = Required(field);
  if (!child.IsMap()) Fail("{}: expected named fields below {}", where_, field);
  return {child, where_ + " (" + field + ")"};
}

double YamlFields::Number(const std::string& field) const {
  return ToNumber(Required(field), where_, field);
}

double YamlFields::NumberOr(const std::string& field, double otherwise) const {
  return Has(field) ? Number(field) : otherwise;
}

std::string YamlFields::Text(const std::string& field) const {
  const YAML::Node child = Required(field);
  if (!child.IsScalar()) Fail("{}: the field {} must be one word", where_, field);
  return child.Scalar();
}

std::vector<double> YamlFields::Numbers(const std::string& field, int count) const {
  std::vector<double> numbers;
  Flatten(Required(field), where_, field, &numbers);
  if (count >= 0 && static_cast<int>(numbers.size()) != count) {
    Fail("{}: the field {} must hold {} numbers, but holds {}", where_, field, count,
         numbers.size());
  }
  return numbers;
}

Rigid3 YamlFields::Transform(const std::string& field) const {
  const bool has_data = Required(field).IsMap();
  const std::vector<double> numbers =
      has_data ? Sub(field).Numbers("data", 16) : Numbers(field, 16);
  const Eigen::Matrix4d matrix =
      Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(numbers.data());
  const Eigen::Matrix3d rotation = matrix.topLeftCorner<3, 3>();
  const double error =
      (rotation * rotation.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  const bool is_rigid = error < 2e-3 && rotation.determinant() > 0 &&
                        matrix.row(3).isApprox(Eigen::RowVector4d(0, 0, 0, 1));
  if (!is_rigid) {
    Fail("{}: the field {} is not a rigid transform (a rotation, a translation, 0 0 0 1)", where_,
         field);
  }
  return Rigid3::FromMatrix(matrix);
}

}  // namespace airslam
