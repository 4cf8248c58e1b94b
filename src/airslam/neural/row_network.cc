// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/neural/row_network.h"

#include <algorithm>
#include <cstddef>

namespace airslam {
namespace {

// Rows that are computed in one run.
constexpr int kRows = 256;

}  // namespace

RowNetwork::RowNetwork(const RowNetworkSpec& spec, int inputs, int outputs,
                       const NetworkLoader& loader)
    : spec_(spec),
      inputs_(inputs),
      outputs_(outputs),
      network_(loader(spec.network.path, {{spec.input, {kRows, inputs}}})),
      input_(static_cast<std::size_t>(kRows) * static_cast<std::size_t>(inputs), 0.0F) {
  network_->RequireOutput(spec.output, {kRows, outputs});
}

// Rows of the last run beyond the last keep what they held: no row looks at another.
std::vector<float> RowNetwork::Run(int count, const FillRow& fill) {
  const NamedTensor input{spec_.input, {input_.data(), {kRows, inputs_}}};
  std::vector<float> result;
  result.reserve(static_cast<std::size_t>(count) * static_cast<std::size_t>(outputs_));
  for (int first = 0; first < count; first += kRows) {
    const int rows = std::min(kRows, count - first);
    for (int i = 0; i < rows; ++i) {
      fill(first + i, input_.data() + static_cast<std::ptrdiff_t>(i) * inputs_);
    }
    network_->Run({&input, 1});
    const float* output = network_->Output(spec_.output).data;
    result.insert(result.end(), output, output + static_cast<std::ptrdiff_t>(rows) * outputs_);
  }
  return result;
}

}  // namespace airslam
