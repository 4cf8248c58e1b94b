// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace airslam {

// Extents of a dense row-major tensor, outermost first. In what a network declares, -1 stands for
// an extent that may vary.
using TensorShape = std::vector<std::int64_t>;

// "1x64x120x188"; a varying extent reads "?".
std::string ToString(const TensorShape& shape);

// Number of values; `shape` has no varying extent.
std::int64_t ElementCount(const TensorShape& shape);

// float values of a dense row-major tensor that somebody else owns.
struct TensorView {
  const float* data = nullptr;
  TensorShape shape;
};

// A value for the network's input `name`.
struct NamedTensor {
  std::string_view name;
  TensorView tensor;
};

// Memory that the network's output `name` is written to.
struct NamedBuffer {
  std::string_view name;
  std::span<float> values;
};

// A named input or output of a network, with its declared shape.
struct TensorPort {
  std::string name;
  TensorShape shape;
};

// A neural network that has been compiled for this machine: named float tensors in, named float
// tensors out. This is all that the rest of the system knows of an inference runtime. One instance
// is used by one thread at a time; equal inputs give equal bits on one CPU type.
class Network {
 public:
  virtual ~Network() = default;

  virtual const std::vector<TensorPort>& inputs() const = 0;
  virtual const std::vector<TensorPort>& outputs() const = 0;

  // Computes the outputs. Every input must be given exactly once, and the data must stay alive and
  // unchanged until the call returns; nothing is copied on the way in. Throws Error that says which
  // name or shape was expected and which was found. Outputs may be given memory of the caller's,
  // which then must outlive their use; give it to an output in every Run or in none.
  void Run(std::span<const NamedTensor> inputs, std::span<const NamedBuffer> outputs = {});

  // The output `name` of the latest Run. Unless the caller gave memory for it, the memory belongs
  // to the network: it is overwritten by the next Run and dies with the network. Throws Error when
  // there is no such output.
  virtual TensorView Output(std::string_view name) const = 0;

  // Throws Error unless the network has the output `name` and its declared shape agrees with
  // `expected`, where -1 on either side agrees with everything.
  void RequireOutput(std::string_view name, const TensorShape& expected) const;

  // Likewise for an input.
  void RequireInput(std::string_view name, const TensorShape& expected) const;

  // The output `name`, an element of outputs(). Throws Error when there is no such output.
  const TensorPort& OutputPort(std::string_view name) const;

  // What the network is called in messages: its file.
  virtual std::string description() const = 0;

 private:
  // The inputs have been checked and are in the order of inputs(); outputs, in the order of
  // outputs(), are null where the network's own memory serves.
  virtual void RunChecked(std::span<const TensorView* const> inputs,
                          std::span<float* const> outputs) = 0;
};

// Loads the network in `file` and fixes the shapes of the named inputs; those not named keep their
// declared shapes. Throws Error that names the file.
using NetworkLoader = std::function<std::unique_ptr<Network>(
    const std::string& file, const std::map<std::string, TensorShape>& input_shapes)>;

}  // namespace airslam
