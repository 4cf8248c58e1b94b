// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <opencv2/core.hpp>
#include <span>
#include <vector>

#include "airslam/neural/feature_detector.h"
#include "airslam/neural/keypoint_decoder.h"
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

// The point-line network of the paper (section IV), so far with its keypoint module: one pass
// gives keypoints and descriptors. Images of any size; the network is reshaped and compiled when
// an image size is seen for the first time, and the networks of the latest sizes are kept.
class PlNet : public FeatureDetector {
 public:
  // Throws Error (from the first Detect) when the network does not fit what the pack says of it.
  explicit PlNet(const FeatureNetworkSpec& spec, NetworkLoader loader = OpenVinoLoader(),
                 const PlNetOptions& options = {});
  ~PlNet() override;

  // Throws Error on an image that is empty or not CV_8UC1, or a mask of another size.
  Detections Detect(const cv::Mat& image, const cv::Mat& mask, int max_keypoints) override;

  int descriptor_size() const override { return spec_.descriptor_size; }

  // Compiles the network for images of this size now rather than at the first of them.
  void Prepare(cv::Size image_size);

 private:
  struct Instance;

  Instance& InstanceFor(cv::Size image_size);

  FeatureNetworkSpec spec_;
  NetworkLoader loader_;
  PlNetOptions options_;
  std::vector<std::unique_ptr<Instance>> instances_;  // latest used last
};

}  // namespace airslam
