// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/neural/transformer_matcher.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <numeric>

#include "airslam/common/error.h"

namespace airslam {
namespace {

// The best `count` keypoints, as ascending indices; of equal scores the earlier count.
std::vector<int> BestIndices(std::span<const Keypoint> keypoints, std::size_t count) {
  std::vector<int> indices(keypoints.size());
  std::iota(indices.begin(), indices.end(), 0);
  if (indices.size() <= count) return indices;
  std::stable_sort(indices.begin(), indices.end(), [&](int a, int b) {
    return keypoints[static_cast<std::size_t>(a)].score >
           keypoints[static_cast<std::size_t>(b)].score;
  });
  indices.resize(count);
  std::sort(indices.begin(), indices.end());
  return indices;
}

bool Has(const std::vector<TensorPort>& ports, std::string_view name) {
  return std::any_of(ports.begin(), ports.end(),
                     [&](const TensorPort& port) { return port.name == name; });
}

// The output that holds the state of a side: the one whose name contains `part`.
std::string StateOutput(const Network& network, std::string_view part) {
  for (const TensorPort& port : network.outputs()) {
    if (port.name.find(part) != std::string::npos) return port.name;
  }
  return network.OutputPort(part).name;  // throws, with the names that there are
}

}  // namespace

double TransformerMatcher::Statistics::MeanStages() const {
  std::int64_t calls = 0, stages = 0;
  for (std::size_t i = 0; i < calls_ended_after.size(); ++i) {
    calls += calls_ended_after[i];
    stages += calls_ended_after[i] * static_cast<std::int64_t>(i + 1);
  }
  return calls == 0 ? 0.0 : static_cast<double>(stages) / static_cast<double>(calls);
}

TransformerMatcher::TransformerMatcher(const MatcherSpec& spec, int descriptor_size,
                                       const NetworkLoader& loader)
    : spec_(spec), descriptor_size_(descriptor_size) {
  for (std::size_t i = 0; i < spec_.stages.size(); ++i) {
    stages_.push_back(loader(spec_.stages[i].path, {}));
    CheckStage(i);
  }
  if (stages_.empty()) Fail("a matcher needs at least one stage");
  statistics_.calls_ended_after.assign(stages_.size(), 0);
  const auto n = static_cast<std::size_t>(spec_.keypoints);
  for (Side* side : {&side0_, &side1_}) {
    side->keypoints.resize(n * 2);
    side->descriptors.resize(n * static_cast<std::size_t>(descriptor_size_));
    side->mask.resize(n);
  }
}

void TransformerMatcher::CheckStage(std::size_t stage) {
  const Network& network = *stages_[stage];
  const std::int64_t n = spec_.keypoints;
  if (stage == 0) {
    network.RequireInput("descriptors0", {1, n, descriptor_size_});
    network.RequireInput("descriptors1", {1, n, descriptor_size_});
  } else {
    const Network& before = *stages_[stage - 1];
    network.RequireInput("state0", before.OutputPort(state0_names_.back()).shape);
    network.RequireInput("state1", before.OutputPort(state1_names_.back()).shape);
  }
  network.RequireOutput("scores", {1, n, n});
  if (stage + 1 == spec_.stages.size()) return;
  state0_names_.push_back(StateOutput(network, "state0"));
  state1_names_.push_back(StateOutput(network, "state1"));
  network.RequireOutput(state0_names_.back(), {1, n, -1});
  network.RequireOutput(state1_names_.back(), {1, n, -1});
  for (const char* name : {"confidence0", "confidence1"}) network.RequireOutput(name, {1, n});
}

void TransformerMatcher::Fill(const MatcherInput& image, Side& side) const {
  side.indices = BestIndices(image.keypoints, static_cast<std::size_t>(spec_.keypoints));
  std::fill(side.keypoints.begin(), side.keypoints.end(), 0.0F);
  std::fill(side.descriptors.begin(), side.descriptors.end(), 0.0F);
  std::fill(side.mask.begin(), side.mask.end(), 0.0F);
  const auto width = static_cast<float>(image.image_size.width);
  const auto height = static_cast<float>(image.image_size.height);
  const float scale = 2.0F / std::max({width, height, 1.0F});
  for (std::size_t i = 0; i < side.indices.size(); ++i) {
    const int index = side.indices[i];
    const Keypoint& k = image.keypoints[static_cast<std::size_t>(index)];
    side.keypoints[2 * i] = (k.x - width / 2) * scale;
    side.keypoints[2 * i + 1] = (k.y - height / 2) * scale;
    side.mask[i] = 1;
    std::copy_n(image.descriptors.data() + static_cast<std::ptrdiff_t>(index) * descriptor_size_,
                descriptor_size_,
                side.descriptors.begin() + static_cast<std::ptrdiff_t>(i) * descriptor_size_);
  }
}

std::vector<NamedTensor> TransformerMatcher::Inputs(std::size_t stage) const {
  const std::int64_t n = spec_.keypoints, d = descriptor_size_;
  std::vector<NamedTensor> inputs = {{"keypoints0", {side0_.keypoints.data(), {1, n, 2}}},
                                     {"keypoints1", {side1_.keypoints.data(), {1, n, 2}}},
                                     {"mask0", {side0_.mask.data(), {1, n}}},
                                     {"mask1", {side1_.mask.data(), {1, n}}}};
  // An exporter drops inputs that a stage does not use.
  std::erase_if(
      inputs, [&](const NamedTensor& input) { return !Has(stages_[stage]->inputs(), input.name); });
  if (stage == 0) {
    inputs.push_back({"descriptors0", {side0_.descriptors.data(), {1, n, d}}});
    inputs.push_back({"descriptors1", {side1_.descriptors.data(), {1, n, d}}});
  } else {
    inputs.push_back({"state0", stages_[stage - 1]->Output(state0_names_[stage - 1])});
    inputs.push_back({"state1", stages_[stage - 1]->Output(state1_names_[stage - 1])});
  }
  return inputs;
}

bool TransformerMatcher::IsSure(const Network& network) const {
  std::size_t sure = 0;
  const auto count = [&](const Side& side, std::string_view name) {
    const float* confidence = network.Output(name).data;
    for (std::size_t i = 0; i < side.indices.size(); ++i) {
      if (confidence[i] > spec_.exit_confidence) ++sure;
    }
  };
  count(side0_, "confidence0");
  count(side1_, "confidence1");
  const std::size_t points = side0_.indices.size() + side1_.indices.size();
  return static_cast<double>(sure) >= kExitShare * static_cast<double>(points);
}

std::vector<airslam::Match> TransformerMatcher::Decode(std::span<const float> scores) const {
  const std::size_t n0 = side0_.indices.size(), n1 = side1_.indices.size();
  const auto stride = static_cast<std::size_t>(spec_.keypoints);
  std::vector<std::size_t> best_column(n0, 0), best_row(n1, 0);
  for (std::size_t i = 0; i < n0; ++i) {
    const std::span<const float> row = scores.subspan(i * stride, n1);
    for (std::size_t j = 0; j < n1; ++j) {
      if (row[j] > row[best_column[i]]) best_column[i] = j;
      if (row[j] > scores[best_row[j] * stride + j]) best_row[j] = i;
    }
  }
  std::vector<airslam::Match> matches;
  for (std::size_t i = 0; i < n0; ++i) {
    const std::size_t j = best_column[i];
    const float score = scores[i * stride + j];
    if (best_row[j] != i || !(score > spec_.threshold)) continue;
    matches.push_back({side0_.indices[i], side1_.indices[j], score});
  }
  return matches;
}

std::vector<airslam::Match> TransformerMatcher::Match(const MatcherInput& image0,
                                                      const MatcherInput& image1) {
  CheckMatcherInputs(image0, image1);
  if (image0.keypoints.empty() || image1.keypoints.empty()) return {};
  if (image0.descriptors.cols() != descriptor_size_) {
    Fail("the matcher was given descriptors of {} values, its network takes {}",
         image0.descriptors.cols(), descriptor_size_);
  }
  Fill(image0, side0_);
  Fill(image1, side1_);
  std::size_t stage = 0;
  for (;; ++stage) {
    stages_[stage]->Run(Inputs(stage));
    if (stage + 1 == stages_.size() || IsSure(*stages_[stage])) break;
  }
  ++statistics_.calls_ended_after[stage];
  const TensorView scores = stages_[stage]->Output("scores");
  return Decode({scores.data, static_cast<std::size_t>(ElementCount(scores.shape))});
}

}  // namespace airslam
