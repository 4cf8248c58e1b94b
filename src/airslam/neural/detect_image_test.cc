// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/neural/detect_image.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

#include "airslam/common/error.h"

namespace airslam {
namespace {

// Sees one line from corner to corner of every image, and remembers what it was asked.
class CornerDetector : public FeatureDetector {
 public:
  struct Call {
    cv::Size image, mask;
    int keypoints;
    bool lines;
  };

  Detections Detect(const cv::Mat& image, const cv::Mat& mask,
                    const DetectionRequest& request) override {
    calls.push_back({image.size(), mask.size(), request.max_keypoints, request.lines});
    Detections found;
    if (request.max_keypoints > 0) found.keypoints = {{3, 4, 1}};
    if (!request.lines) return found;
    const auto x = static_cast<float>(image.cols - 1), y = static_cast<float>(image.rows - 1);
    found.junctions = {{0, 0, 1}, {x, y, 1}};
    found.lines = {{0, 0, x, y, 0.9F}};
    found.line_ends = {{0, 1}};
    found.junction_descriptors = DescriptorMatrix::Identity(2, 2);
    return found;
  }
  bool finds_lines() const override { return has_lines; }
  int descriptor_size() const override { return 2; }

  std::vector<Call> calls;
  bool has_lines = true;
};

cv::Mat Grey(cv::Size size) { return {size, CV_8UC1, cv::Scalar(90)}; }

TEST(DetectImage, LooksForLinesInTheEnlargedImageAndTellsPlacesInTheImage) {
  CornerDetector detector;
  const cv::Mat mask = Grey({100, 60});
  const Detections found = DetectImage(Grey({100, 60}), mask, {7}, detector);
  ASSERT_EQ(detector.calls.size(), 2U);
  EXPECT_EQ(detector.calls[0].image, cv::Size(100, 60));
  EXPECT_EQ(detector.calls[0].keypoints, 7);
  EXPECT_FALSE(detector.calls[0].lines);
  EXPECT_EQ(detector.calls[1].image, cv::Size(200, 120));
  EXPECT_EQ(detector.calls[1].mask, cv::Size(200, 120));
  EXPECT_EQ(detector.calls[1].keypoints, 0);
  ASSERT_EQ(found.keypoints.size(), 1U);
  EXPECT_EQ(found.keypoints[0].x, 3);
  // The middle of the enlarged image's first pixel lies a quarter of one before the image's.
  ASSERT_EQ(found.lines.size(), 1U);
  EXPECT_EQ(found.lines[0].x1, 0);
  EXPECT_EQ(found.lines[0].y1, 0);
  EXPECT_EQ(found.lines[0].x2, 99);
  EXPECT_EQ(found.lines[0].y2, 59);
  EXPECT_EQ(found.junctions[1].x, found.lines[0].x2);
  EXPECT_EQ(found.line_ends.size(), 1U);
  EXPECT_EQ(found.junction_descriptors.rows(), 2);
}

TEST(DetectImage, OnePassWhereNothingIsEnlarged) {
  CornerDetector detector;
  DetectImage(Grey({1500, 720}), {}, {7}, detector);  // large enough
  DetectImage(Grey({100, 60}), {}, {7, true, 0, 1}, detector);
  DetectImage(Grey({100, 60}), {}, {7, false}, detector);
  detector.has_lines = false;
  DetectImage(Grey({100, 60}), {}, {7}, detector);
  ASSERT_EQ(detector.calls.size(), 4U);
  for (const CornerDetector::Call& call : detector.calls) EXPECT_EQ(call.keypoints, 7);
  EXPECT_TRUE(detector.calls[1].lines);
  EXPECT_FALSE(detector.calls[2].lines);
}

TEST(DetectImage, EnlargesUpToTheSideThatIsEnough) {
  CornerDetector detector;
  DetectImage(Grey({900, 600}), {}, {7}, detector);
  DetectImage(Grey({600, 900}), {}, {7, true, 0, 1.1F}, detector);
  EXPECT_EQ(detector.calls[1].image, cv::Size(1080, 720));
  EXPECT_EQ(detector.calls[3].image, cv::Size(660, 990));
}

TEST(DetectImage, SaysWhichNumberIsOutOfItsRange) {
  CornerDetector detector;
  const auto error_of = [&](const ImageRequest& request) -> std::string {
    try {
      DetectImage(Grey({100, 60}), {}, request, detector);
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(error_of({-1}), "max_keypoints = -1 must be at least 0");
  EXPECT_EQ(error_of({7, true, 1.5F}), "min_line_score = 1.5 must be between 0 and 1");
  EXPECT_EQ(error_of({7, true, 0, 0.5F}), "line_scale = 0.5 must be between 1 and 4");
  EXPECT_TRUE(detector.calls.empty());
}

}  // namespace
}  // namespace airslam
