// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "airslam/neural/line_decoder.h"
#include "airslam/neural/map_sampling.h"

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

// A network that turns rows of features into rows of numbers (row_network.h): `input` N x F ->
// `output` N x G.
struct RowNetworkSpec {
  PackFile network;
  std::string input, output;
};

// A map that a network hands out: (h w) x channels with h = H/stride, w = W/stride in the layout
// kCells, else 1 x channels x h x w.
struct FeatureMapSpec {
  std::string output;
  int channels = 0;
  int stride = 4;  // pixels a cell
};

// A map that is pooled along lines, in the layout kCells.
struct PooledMapSpec {
  FeatureMapSpec map;
  int samples = 32;  // along a line
  // Pixels from an end into the line, negative beyond it, where either end is sampled, too.
  std::vector<float> end_offsets;
};

// The network of lines: the maps of the feature network (its inputs are called like the feature
// network's outputs, and are 1 x h x w x channels) -> the maps of lines (line_decoder.h), and the
// classifier of proposals -> a logit. It reads what is pooled along a line of each map in turn,
// kLineExtras numbers, then of each map what is pooled about the start, and about the end.
struct LineNetworkSpec {
  PackFile network;
  std::string field;                  // 1x6xhxw with h = H/decoder.stride, w = W/decoder.stride
  std::string junctions;              // 1x3xhxw
  std::vector<PooledMapSpec> pooled;  // at least one
  RowNetworkSpec classifier;
  LineDecoderOptions decoder;
};

// The feature network: `input` 1x1xHxW -> score logits and the maps that descriptors are sampled
// of. With a descriptor head a point's samples of all maps, side by side, go through it; without,
// there is one map of `descriptor_size` channels. Either way the result is scaled to unit length.
struct FeatureNetworkSpec {
  PackFile network;
  std::string input;
  Normalization normalization = Normalization::kUnit;
  int multiple = 32;  // H and W must be multiples of it, and it of every stride
  std::string scores;
  int score_stride = 1;  // s: the scores are 1x1xHxW for 1, else (HW/s^2) x s^2, cell after cell
  MapLayout layout = MapLayout::kPlanes;
  std::vector<FeatureMapSpec> maps;  // at least one
  // Where pixel x lies in a map: true: (x + 0.5) / stride - 0.5, false: x / stride.
  bool half_pixel = true;
  std::optional<RowNetworkSpec> descriptor_head;
  int descriptor_size = 64;    // D
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
