// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "airslam/neural/feature_detector.h"
#include "airslam/neural/nearest_matcher.h"

namespace airslam {

// A stand-in for PLNet in tests, without a network: OpenCV's line segments and Shi-Tomasi corners
// at sub-pixel positions with the normalised 8 x 8 patch around each as descriptor (mean removed,
// unit length, so that gain and offset of the light do not matter). Good for the small turns of a
// sequence, deterministic.
class SyntheticDetector : public FeatureDetector {
 public:
  struct Options {
    double quality = 0.005;   // a corner's strength relative to the image's strongest
    double min_distance = 7;  // pixels between corners
    bool lines = false;       // whether lines are found when they are asked for
    double min_line = 25;     // pixels: shorter ones are left out
  };

  SyntheticDetector() = default;
  explicit SyntheticDetector(const Options& options) : options_(options) {}

  Detections Detect(const cv::Mat& image, const cv::Mat& mask,
                    const DetectionRequest& request) override;
  int descriptor_size() const override { return 64; }
  bool finds_lines() const override { return options_.lines; }

 private:
  void DetectLines(const cv::Mat& image, Detections& detections) const;

  Options options_;
};

// A stand-in for the matcher network: mutual nearest neighbours, strict enough that repeated
// texture stays unmatched.
class SyntheticMatcher : public NearestMatcher {
 public:
  SyntheticMatcher() : NearestMatcher({.min_cosine = 0.85F, .max_squared_ratio = 0.65F}) {}
};

}  // namespace airslam
