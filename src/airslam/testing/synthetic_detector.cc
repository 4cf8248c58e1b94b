// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/testing/synthetic_detector.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace airslam {
namespace {

constexpr int kPatch = 8;         // samples along a side of a descriptor's patch
constexpr double kSpacing = 2.0;  // pixels between them
constexpr double kBorder = 0.5 * (kPatch - 1) * kSpacing + 2;

// CV_32FC1 at a sub-pixel position that lies inside.
float Sample(const cv::Mat& image, double x, double y) {
  const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
  const auto fx = static_cast<float>(x - x0), fy = static_cast<float>(y - y0);
  const float* top = image.ptr<float>(y0) + x0;
  const float* bottom = image.ptr<float>(y0 + 1) + x0;
  return (1 - fy) * ((1 - fx) * top[0] + fx * top[1]) +
         fy * ((1 - fx) * bottom[0] + fx * bottom[1]);
}

Eigen::Matrix<float, 1, kPatch * kPatch> Describe(const cv::Mat& smooth, const Keypoint& keypoint) {
  Eigen::Matrix<float, 1, kPatch * kPatch> descriptor;
  for (int i = 0; i < kPatch * kPatch; ++i) {
    const double dx = (i % kPatch - 0.5 * (kPatch - 1)) * kSpacing;
    const double dy = (i / kPatch - 0.5 * (kPatch - 1)) * kSpacing;
    descriptor[i] = Sample(smooth, keypoint.x + dx, keypoint.y + dy);
  }
  descriptor.array() -= descriptor.mean();
  return descriptor / std::max(descriptor.norm(), 1e-6f);
}

}  // namespace

// Each segment has two junctions of its own, described alike.
void SyntheticDetector::DetectLines(const cv::Mat& image, Detections& detections) const {
  std::vector<cv::Vec4f> segments;
  cv::createLineSegmentDetector()->detect(image, segments);
  for (const cv::Vec4f& s : segments) {
    if (std::hypot(s[2] - s[0], s[3] - s[1]) < options_.min_line) continue;
    const int first = static_cast<int>(detections.junctions.size());
    detections.lines.push_back({s[0], s[1], s[2], s[3], 1});
    detections.line_ends.push_back({first, first + 1});
    detections.junctions.push_back({s[0], s[1], 1});
    detections.junctions.push_back({s[2], s[3], 1});
  }
  const float component = 1 / std::sqrt(static_cast<float>(descriptor_size()));
  detections.junction_descriptors = DescriptorMatrix::Constant(
      static_cast<Eigen::Index>(detections.junctions.size()), descriptor_size(), component);
}

Detections SyntheticDetector::Detect(const cv::Mat& image, const cv::Mat& mask,
                                     const DetectionRequest& request) {
  const int max_keypoints = request.max_keypoints;
  const auto border = static_cast<int>(std::ceil(kBorder)) + 1;
  Detections detections;
  if (request.lines && options_.lines) DetectLines(image, detections);
  detections.descriptors.resize(0, descriptor_size());
  if (max_keypoints <= 0 || image.cols <= 2 * border || image.rows <= 2 * border) return detections;
  cv::Mat inside = cv::Mat::zeros(image.size(), CV_8UC1);
  const cv::Rect area(border, border, image.cols - 2 * border, image.rows - 2 * border);
  if (mask.empty()) {
    inside(area).setTo(255);
  } else {
    mask(area).copyTo(inside(area));
  }
  cv::Mat smooth;
  image.convertTo(smooth, CV_32FC1);
  cv::GaussianBlur(smooth, smooth, cv::Size(0, 0), 1.2);
  std::vector<cv::Point2f> corners;
  std::vector<float> strengths;
  cv::goodFeaturesToTrack(smooth, corners, max_keypoints, options_.quality, options_.min_distance,
                          inside, strengths, 5, 3);
  if (corners.empty()) return detections;
  const std::vector<cv::Point2f> coarse = corners;
  cv::cornerSubPix(smooth, corners, cv::Size(3, 3), cv::Size(-1, -1),
                   cv::TermCriteria(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 20, 0.01));
  for (std::size_t i = 0; i < corners.size(); ++i) {
    if (cv::norm(corners[i] - coarse[i]) > 1.5) corners[i] = coarse[i];  // it ran away
    detections.keypoints.push_back({corners[i].x, corners[i].y, strengths[i] / strengths[0]});
  }
  std::stable_sort(detections.keypoints.begin(), detections.keypoints.end(),
                   [](const Keypoint& a, const Keypoint& b) {
                     if (a.score != b.score) return a.score > b.score;
                     return a.y != b.y ? a.y < b.y : a.x < b.x;
                   });
  detections.descriptors.resize(static_cast<Eigen::Index>(corners.size()), descriptor_size());
  for (std::size_t i = 0; i < corners.size(); ++i) {
    detections.descriptors.row(static_cast<Eigen::Index>(i)) =
        Describe(smooth, detections.keypoints[i]);
  }
  return detections;
}

}  // namespace airslam
