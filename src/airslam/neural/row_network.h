// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "airslam/neural/model_pack.h"
#include "airslam/neural/network.h"

namespace airslam {

// A small network that turns rows of features into rows of numbers, each row on its own: PLNet's
// descriptor head and its classifier of line proposals. It is compiled for a fixed number of rows
// and run as often as it takes.
class RowNetwork {
 public:
  // Writes row `index` of the input.
  using FillRow = std::function<void(int index, float* row)>;

  // Throws Error when the network does not take rows of `inputs` and give rows of `outputs`
  // numbers.
  RowNetwork(const RowNetworkSpec& spec, int inputs, int outputs, const NetworkLoader& loader);

  // count x outputs numbers, row after row.
  std::vector<float> Run(int count, const FillRow& fill);

 private:
  RowNetworkSpec spec_;
  int inputs_, outputs_;
  std::unique_ptr<Network> network_;
  std::vector<float> input_;
};

}  // namespace airslam
