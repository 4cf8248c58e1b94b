// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <memory>
#include <opencv2/core.hpp>
#include <span>
#include <vector>

#include "airslam/neural/feature_detector.h"
#include "airslam/neural/image_maps.h"
#include "airslam/neural/keypoint_decoder.h"
#include "airslam/neural/line_decoder.h"
#include "airslam/neural/map_sampling.h"
#include "airslam/neural/model_pack.h"
#include "airslam/neural/network.h"
#include "airslam/neural/openvino_network.h"
#include "airslam/neural/row_network.h"

namespace airslam {

struct PlNetOptions {
  // Threshold, suppression radius and number of keypoints are set by the pack and by the call.
  KeypointDecoderOptions decoder;
};

// Grey levels of an image as the network's input. out: height x width floats, at least as large as
// the image, whose last column and row are repeated to the right and below.
void NormalizeImage(const cv::Mat& image, Normalization normalization, int width, int height,
                    float* out);

// The point-line network of the paper (section IV). One pass over an image gives the scores of its
// pixels and maps of features; descriptors of keypoints and junctions are read of the maps at these
// points only, and lines are found in the maps where they are asked for, at once or later. Images
// of any size; a network is reshaped and compiled when an image size is seen for the first time,
// and the networks of the latest sizes are kept.
class PlNet : public FeatureDetector {
 public:
  // Throws Error (from the first Detect) when a network does not fit what the pack says of it.
  explicit PlNet(const FeatureNetworkSpec& spec, NetworkLoader loader = OpenVinoLoader(),
                 const PlNetOptions& options = {});
  ~PlNet() override;

  // Throws Error on an image that is empty or not CV_8UC1, or a mask of another size.
  // Without a line module in the pack a request for lines is answered without.
  Detections Detect(const cv::Mat& image, const cv::Mat& mask,
                    const DetectionRequest& request) override;
  Detections FindLines(const cv::Mat& image, const cv::Mat& mask, const Detections& seen,
                       DetectionRequest request) override;

  int descriptor_size() const override { return spec_.descriptor_size; }
  bool finds_lines() const override { return spec_.lines.has_value(); }

  // Compiles what finds features, or lines, in images of this size now rather than at the first of
  // them. Throws Error when a network does not fit what the pack says of it.
  void PrepareFeatures(cv::Size image_size) { WithFeatures(image_size); }
  void PrepareLines(cv::Size image_size) {
    if (finds_lines()) WithLines(image_size);
  }

 private:
  struct Instance;

  Instance& InstanceFor(cv::Size image_size);
  Instance& WithFeatures(cv::Size image_size);  // its networks are loaded
  Instance& WithLines(cv::Size image_size);
  void LoadFeatures(Instance& instance);
  void LoadLines(Instance& instance);
  void LoadDescriptorHead();
  int SampledChannels() const;  // of all maps
  FeatureMap MapOf(const ImageMaps& maps, std::size_t index) const;
  std::vector<Keypoint> FindKeypoints(Instance& instance, const cv::Mat& mask, int count) const;
  DescriptorMatrix Describe(const ImageMaps& maps, std::span<const Keypoint> points);
  void AddLines(const ImageMaps& maps, const cv::Mat& mask, const DetectionRequest& request,
                Detections& detections);
  std::vector<float> Classify(const Instance& instance, std::span<const Keypoint> junctions,
                              std::span<const LineProposal> proposals);

  FeatureNetworkSpec spec_;
  NetworkLoader loader_;
  PlNetOptions options_;
  std::vector<std::unique_ptr<Instance>> instances_;  // latest used last
  std::unique_ptr<RowNetwork> descriptor_head_;       // if the pack has one
  std::unique_ptr<RowNetwork> classifier_;            // loaded with the first image with lines
  ImageMapPool pool_;
};

}  // namespace airslam
