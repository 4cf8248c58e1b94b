// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/neural/network.h"

#include <algorithm>
#include <utility>

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

const TensorPort& Find(const std::vector<TensorPort>& ports, const char* kind,
                       std::string_view name, const std::string& network) {
  for (const TensorPort& port : ports) {
    if (port.name == name) return port;
  }
  Fail("{}: the network has no {} '{}'; it has {}", network, kind, name, Names(ports));
}

void Require(const TensorPort& port, const char* kind, const TensorShape& expected,
             const std::string& network) {
  if (Agree(port.shape, expected)) return;
  Fail("{}: {} '{}' has the shape {}, expected {}", network, kind, port.name, ToString(port.shape),
       ToString(expected));
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

void Network::Run(std::span<const NamedTensor> given, std::span<const NamedBuffer> buffers) {
  const std::vector<TensorPort>& ports = inputs();
  std::vector<const TensorView*> ordered(ports.size(), nullptr);
  for (const NamedTensor& input : given) {
    const TensorPort& port = Find(ports, "input", input.name, description());
    if (!Agree(port.shape, input.tensor.shape)) {
      Fail("{}: the input '{}' was given with the shape {}, expected {}", description(), port.name,
           ToString(input.tensor.shape), ToString(port.shape));
    }
    const TensorView*& slot = ordered[static_cast<std::size_t>(&port - ports.data())];
    if (slot != nullptr) Fail("{}: the input '{}' was given twice", description(), port.name);
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
  std::vector<float*> memory(outputs().size(), nullptr);
  for (const NamedBuffer& buffer : buffers) {
    const TensorPort& port = OutputPort(buffer.name);
    if (std::cmp_not_equal(buffer.values.size(), ElementCount(port.shape))) {
      Fail("{}: the output '{}' ({}) was given memory for {} values", description(), port.name,
           ToString(port.shape), buffer.values.size());
    }
    memory[static_cast<std::size_t>(&port - outputs().data())] = buffer.values.data();
  }
  RunChecked(ordered, memory);
}

void Network::RequireOutput(std::string_view name, const TensorShape& expected) const {
  Require(OutputPort(name), "output", expected, description());
}

void Network::RequireInput(std::string_view name, const TensorShape& expected) const {
  Require(Find(inputs(), "input", name, description()), "input", expected, description());
}

const TensorPort& Network::OutputPort(std::string_view name) const {
  return Find(outputs(), "output", name, description());
}

}  // namespace airslam
