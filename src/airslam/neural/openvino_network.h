// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <memory>
#include <string>

#include "airslam/neural/network.h"

namespace airslam {

// In which arithmetic a network is computed. Tensors at its borders are float in any case.
enum class Precision {
  kAuto,  // bf16 where it is the faster (IsFasterInBf16), else f32
  kF32,
  kBf16,  // emulated, and slow, on a CPU without it
};

// How OpenVINO runs a network on the CPU. Everything that could change a result or its speed
// behind our back is set, none is left to the runtime's heuristics.
struct OpenVinoOptions {
  Precision precision = Precision::kAuto;
  int threads = 1;  // >= 1; 1 is the most efficient use of two cores shared with other stages
  // Folder that keeps compiled networks, so that the next start takes milliseconds. "auto" is
  // $XDG_CACHE_HOME/airslam or ~/.cache/airslam, empty is none. A folder that cannot be written is
  // not an error: the network is then compiled at every start.
  std::string cache_folder = "auto";

  // Throws Error that names the wrong field.
  void Validate() const;
};

// The runtime's version, e.g. "2026.4.1".
std::string OpenVinoVersion();

// Whether this CPU multiplies bf16 faster than f32: in matrices (AMX), or by AVX512-BF16 unless it
// is Intel's, where that alone makes a pass of PLNet 1.2 times, one of the matcher 1.6 times as
// long (Emerald Rapids, AMX hidden).
bool IsFasterInBf16();

// The folder that "auto" stands for, created if need be; empty when there is none to write to.
std::string DefaultCacheFolder();

// Reads the network in `file` (ONNX or OpenVINO IR), sets the shapes of the named inputs and
// compiles it for the CPU. Inputs and outputs must be float. Throws Error that names the file.
std::unique_ptr<Network> LoadOpenVinoNetwork(const std::string& file,
                                             const std::map<std::string, TensorShape>& input_shapes,
                                             const OpenVinoOptions& options = {});

// A loader for classes that are written against any runtime.
NetworkLoader OpenVinoLoader(const OpenVinoOptions& options = {});

}  // namespace airslam
