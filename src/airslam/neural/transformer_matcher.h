// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "airslam/neural/feature_matcher.h"
#include "airslam/neural/model_pack.h"
#include "airslam/neural/network.h"
#include "airslam/neural/openvino_network.h"

namespace airslam {

// A LightGlue-style transformer with early exit (paper, section V-B): its layers come in stages,
// one network file each, and easy pairs need only the first.
//
// Every stage works on N points a side (the pack's `keypoints`); missing ones are masked.
//   stage 0   keypoints0, keypoints1    1xNx2   (k - size / 2) / (max(size) / 2)
//             descriptors0, ...1        1xNxD   unit length
//             mask0, mask1              1xN     1 for a point, 0 for none
//   later     state0, state1 (1xNxW, of the stage before), keypoints0, ...1, mask0, mask1
//   outputs   state0, state1            1xNxW   (the last stage may do without; since ONNX forbids
//                                               an output to be called as an input, any name that
//                                               contains "state0" is understood: "next_state0")
//             scores                    1xNxN   probability that row i and column j match
//             confidence0, ...1         1xN     probability that further stages change nothing
//                                               (the last stage may do without)
class TransformerMatcher : public FeatureMatcher {
 public:
  // The stages stop when at least this share of the points of both images is sure, that is, has a
  // confidence above the pack's `exit_confidence` (LightGlue's setting).
  static constexpr double kExitShare = 0.95;

  // How many calls ended after each stage, since the start.
  struct Statistics {
    std::vector<std::int64_t> calls_ended_after;  // one entry a stage
    // Mean number of stages of a call, 0 before the first.
    double MeanStages() const;
  };

  // descriptor_size: D. Throws Error when a stage cannot be loaded or does not fit the above.
  TransformerMatcher(const MatcherSpec& spec, int descriptor_size,
                     const NetworkLoader& loader = OpenVinoLoader());

  // Matches are mutually most probable, more probable than the pack's threshold. Of more than N
  // keypoints the N with the best scores take part. A match's score is its probability. Throws
  // Error when keypoints and descriptors differ in number, or descriptors are not D long.
  std::vector<airslam::Match> Match(const MatcherInput& image0,
                                    const MatcherInput& image1) override;

  const Statistics& statistics() const { return statistics_; }

 private:
  // The points of one image as the stages take them.
  struct Side {
    std::vector<int> indices;  // of the points that take part, in the caller's numbering, ascending
    std::vector<float> keypoints, descriptors, mask;
  };

  void CheckStage(std::size_t stage);
  void Fill(const MatcherInput& image, Side& side) const;
  std::vector<NamedTensor> Inputs(std::size_t stage) const;
  bool IsSure(const Network& network) const;
  std::vector<airslam::Match> Decode(std::span<const float> scores) const;

  MatcherSpec spec_;
  int descriptor_size_;
  std::vector<std::unique_ptr<Network>> stages_;
  std::vector<std::string> state0_names_, state1_names_;  // of the outputs, of all but the last
  Side side0_, side1_;
  Statistics statistics_;
};

}  // namespace airslam
