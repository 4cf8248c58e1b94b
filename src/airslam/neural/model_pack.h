// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "airslam/neural/line_decoder.h"

namespace airslam {

// The pack that is used when none is named.
inline constexpr char kDefaultModelPack[] = "airslam-fast";

// How grey levels become the network's input.
enum class Normalization {
  kUnit,         // grey / 255
  kStandardize,  // (grey - mean) / max(standard deviation, 2), both over the whole image, 0..255
};

// A network of a pack, whose file has the SHA-256 that the manifest states.
struct PackFile {
  std::string path;    // of the file, with the pack's folder
  std::string sha256;  // 64 lower-case hexadecimal digits
};

// A network that computes all that the feature network does, and the maps of lines
// (line_decoder.h), and the classifier of proposals: `classifier_input` N x (samples * channels +
// kLineExtras) -> `classifier_output` N.
struct LineNetworkSpec {
  PackFile network;
  std::string field;      // 1x6xhxw with h = H/stride, w = W/stride
  std::string junctions;  // 1x3xhxw
  std::string pooled;     // 1xhxwxchannels: features to pool along lines
  int channels = 16;
  int samples = 32;  // along a line
  PackFile classifier;
  std::string classifier_input, classifier_output;
  LineDecoderOptions decoder;
};

// The feature network: `input` 1x1xHxW -> `descriptors` 1xDx(H/stride)x(W/stride), not normalised,
// and `scores` 1x1xHxW, logits.
struct FeatureNetworkSpec {
  PackFile network;
  std::string input;
  Normalization normalization = Normalization::kUnit;
  int multiple = 32;  // H and W must be multiples of it
  std::string descriptors;
  std::string scores;
  int descriptor_size = 64;   // D
  int descriptor_stride = 4;  // pixels a cell of the descriptor map
  // Where pixel x lies in the descriptor map: true: (x + 0.5) / stride - 0.5, false: x / stride.
  bool half_pixel = true;
  float score_threshold = -5;  // keypoints have a larger logit
  int nms_radius = 2;          // pixels; a keypoint has the largest logit of its square
  std::optional<LineNetworkSpec> lines;
};

// The staged matcher; see transformer_matcher.h for what its stages take and give.
struct MatcherSpec {
  int keypoints = 400;            // N, of each image
  float threshold = 0.1F;         // a match is more probable than this
  float exit_confidence = 0.95F;  // a point surer than this needs no further stage
  std::vector<PackFile> stages;   // at least one
};

// A folder of networks that belong together, as its manifest.json describes it.
struct ModelPack {
  std::string name;
  std::string license;
  std::string folder;
  std::string sha256;  // of manifest.json, and so of the whole pack
  FeatureNetworkSpec features;
  std::optional<MatcherSpec> matcher;
  // Words for place recognition (place/vocabulary.h), trained on descriptors of `features`.
  std::optional<PackFile> vocabulary;
};

// The folder of the pack `name_or_path`: that folder if it exists, else a pack of that name among
// the installed ones (<folder of the program>/../share/airslam/models, for the program in a Python
// package ../models) or those of the source tree (../../models). For code in a Python module:
// among those beside the module (<folder of the module>/models). Throws Error that lists where it
// looked.
std::string FindModelPack(const std::string& name_or_path);

// Reads and checks `folder`/manifest.json and the files that it names. Throws Error on a missing
// folder or file, another format version, a field that is missing, of the wrong type or out of
// range (it is named), and on a file whose SHA-256 differs.
ModelPack ReadModelPack(const std::string& folder);

// ReadModelPack(FindModelPack(name_or_path)).
ModelPack LoadModelPack(const std::string& name_or_path = kDefaultModelPack);

}  // namespace airslam
