// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <span>
#include <vector>

#include "airslam/neural/feature_detector.h"
#include "airslam/neural/keypoint_decoder.h"
#include "airslam/neural/line_decoder.h"
#include "airslam/neural/model_pack.h"
#include "airslam/neural/network.h"
#include "airslam/neural/openvino_network.h"

namespace airslam {

struct PlNetOptions {
  // Threshold, suppression radius and number of keypoints are set by the pack and by the call.
  KeypointDecoderOptions decoder;
};

// Grey levels of an image as the network's input. out: height x width floats, at least as large as
// the image, whose last column and row are repeated to the right and below.
void NormalizeImage(const cv::Mat& image, Normalization normalization, int width, int height,
                    float* out);

// Descriptors at keypoints: bilinear samples of a map 1xDxhxw, then scaled to unit length (a zero
// vector stays zero). Positions outside the map are clamped to it.
DescriptorMatrix SampleDescriptors(const TensorView& map, std::span<const Keypoint> keypoints,
                                   int stride, bool half_pixel);

// The point-line network of the paper (section IV): one pass gives keypoints and descriptors and,
// when they are asked for, lines and junctions. The pack holds the network without and with the
// line module, so that frames without lines do not pay for them. Images of any size; a network is
// reshaped and compiled when an image size is seen for the first time, and the networks of the
// latest sizes are kept.
class PlNet : public FeatureDetector {
 public:
  // Throws Error (from the first Detect) when the network does not fit what the pack says of it.
  explicit PlNet(const FeatureNetworkSpec& spec, NetworkLoader loader = OpenVinoLoader(),
                 const PlNetOptions& options = {});
  ~PlNet() override;

  // Throws Error on an image that is empty or not CV_8UC1, or a mask of another size.
  // Without a line module in the pack a request for lines is answered without.
  Detections Detect(const cv::Mat& image, const cv::Mat& mask,
                    const DetectionRequest& request) override;

  int descriptor_size() const override { return spec_.descriptor_size; }
  bool finds_lines() const override { return spec_.lines.has_value(); }

  // Compiles the network for images of this size now rather than at the first of them, with or
  // without the line module.
  void Prepare(cv::Size image_size, bool lines = false);

 private:
  struct Instance;

  Instance& InstanceFor(cv::Size image_size, bool lines);
  void LoadLineModule(const Network& network, std::int64_t height, std::int64_t width);
  void DetectLines(const Network& network, const cv::Mat& image, const cv::Mat& mask,
                   const DetectionRequest& request, Detections& detections);
  std::vector<float> Classify(const Network& network, std::span<const Keypoint> junctions,
                              std::span<const LineProposal> proposals);

  FeatureNetworkSpec spec_;
  NetworkLoader loader_;
  PlNetOptions options_;
  std::vector<std::unique_ptr<Instance>> instances_;  // latest used last
  std::unique_ptr<Network> classifier_;               // loaded with the first instance with lines
  std::vector<float> classifier_input_;
};

}  // namespace airslam
