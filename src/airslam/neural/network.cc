// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/neural/network.h"

#include <algorithm>

#include "airslam/common/error.h"

namespace airslam {
namespace {

// Whether two declared shapes can be the same; a varying extent agrees with everything.
bool Agree(const TensorShape& a, const TensorShape& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](std::int64_t x, std::int64_t y) { return x < 0 || y < 0 || x == y; });
}

std::string Names(const std::vector<TensorPort>& ports) {
  std::string names;
  for (const TensorPort& port : ports) names += (names.empty() ? "'" : ", '") + port.name + "'";
  return names.empty() ? "none" : names;
}

void Require(const std::vector<TensorPort>& ports, const char* kind, std::string_view name,
             const TensorShape& expected, const std::string& network) {
  const auto port =
      std::find_if(ports.begin(), ports.end(), [&](const TensorPort& p) { return p.name == name; });
  if (port == ports.end()) {
    Fail("{}: the network has no {} '{}'; it has {}", network, kind, name, Names(ports));
  }
  if (!Agree(port->shape, expected)) {
    Fail("{}: {} '{}' has the shape {}, expected {}", network, kind, name, ToString(port->shape),
         ToString(expected));
  }
}

}  // namespace

std::string ToString(const TensorShape& shape) {
  if (shape.empty()) return "scalar";
  std::string text;
  for (const std::int64_t extent : shape) {
    if (!text.empty()) text += 'x';
    text += extent < 0 ? "?" : std::to_string(extent);
  }
  return text;
}

std::int64_t ElementCount(const TensorShape& shape) {
  std::int64_t count = 1;
  for (const std::int64_t extent : shape) count *= extent;
  return count;
}

void Network::Run(std::span<const NamedTensor> given) {
  const std::vector<TensorPort>& ports = inputs();
  std::vector<const TensorView*> ordered(ports.size(), nullptr);
  for (const NamedTensor& input : given) {
    Require(ports, "input", input.name, input.tensor.shape, description());
    const auto port = std::find_if(ports.begin(), ports.end(),
                                   [&](const TensorPort& p) { return p.name == input.name; });
    const TensorView*& slot = ordered[static_cast<std::size_t>(port - ports.begin())];
    if (slot != nullptr) Fail("{}: the input '{}' was given twice", description(), input.name);
    if (std::any_of(input.tensor.shape.begin(), input.tensor.shape.end(),
                    [](std::int64_t extent) { return extent < 0; })) {
      Fail("{}: the input '{}' was given with the unknown shape {}", description(), input.name,
           ToString(input.tensor.shape));
    }
    slot = &input.tensor;
  }
  for (std::size_t i = 0; i < ports.size(); ++i) {
    if (ordered[i] == nullptr) {
      Fail("{}: the input '{}' ({}) was not given", description(), ports[i].name,
           ToString(ports[i].shape));
    }
  }
  RunChecked(ordered);
}

void Network::RequireOutput(std::string_view name, const TensorShape& expected) const {
  Require(outputs(), "output", name, expected, description());
}

void Network::RequireInput(std::string_view name, const TensorShape& expected) const {
  Require(inputs(), "input", name, expected, description());
}

}  // namespace airslam
