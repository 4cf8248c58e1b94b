// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/neural/plnet.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>
#include <thread>
#include <vector>

#include "airslam/common/error.h"

namespace airslam {
namespace {

constexpr char kData[] = AIRSLAM_SOURCE_DIR "/src/airslam/neural/testdata";
constexpr char kPack[] = AIRSLAM_SOURCE_DIR "/src/airslam/neural/testdata/pack";

NetworkLoader ExactLoader() {
  OpenVinoOptions options;
  options.precision = Precision::kF32;
  options.cache_folder.clear();
  return OpenVinoLoader(options);
}

// The precision that is used in earnest, whatever it is on this CPU.
NetworkLoader UsualLoader() {
  OpenVinoOptions options;
  options.cache_folder.clear();
  return OpenVinoLoader(options);
}

FeatureNetworkSpec Spec() { return ReadModelPack(kPack).features; }

// Bright dots on grey, at these places; the test network's score peaks on them.
cv::Mat Dots(cv::Size size, const std::vector<cv::Point>& dots) {
  cv::Mat image(size, CV_8UC1, cv::Scalar(100));
  int level = 255;
  for (const cv::Point& dot : dots) {
    image.at<std::uint8_t>(dot) = static_cast<std::uint8_t>(level);
    level -= 10;
  }
  return image;
}

TEST(PlNet, FindsDotsBestFirst) {
  PlNet plnet(Spec(), ExactLoader());
  const std::vector<cv::Point> dots = {{40, 12}, {10, 20}, {25, 30}};
  // 61x45 is padded to 64x48.
  const Detections found = plnet.Detect(Dots({61, 45}, dots), cv::Mat(), 10);
  ASSERT_EQ(found.keypoints.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(found.keypoints[i].x, static_cast<float>(dots[i].x), 1e-3);
    EXPECT_NEAR(found.keypoints[i].y, static_cast<float>(dots[i].y), 1e-3);
    const double contrast = (155.0 - 10.0 * static_cast<double>(i)) / 255.0;
    EXPECT_NEAR(found.keypoints[i].score, 10 * contrast - 6, 1e-3);
  }
  EXPECT_EQ(found.descriptors.rows(), 3);
  EXPECT_EQ(found.descriptors.cols(), plnet.descriptor_size());
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(found.descriptors.row(i).norm(), 1, 1e-5);
  EXPECT_EQ(plnet.Detect(Dots({61, 45}, dots), cv::Mat(), 2).keypoints.size(), 2U);
}

// At a cell's centre nothing is interpolated: what the test networks compute can be done by hand.
TEST(PlNet, DescriptorsComeOfAllMapsThroughTheHead) {
  cv::Mat image(48, 64, CV_8UC1);
  cv::RNG(3).fill(image, cv::RNG::UNIFORM, 0, 60);
  image.at<std::uint8_t>(19, 27) = 255;
  DetectionRequest request(1);
  request.keep_maps = true;
  const Detections found = PlNet(Spec(), ExactLoader()).Detect(image, cv::Mat(), request);
  ASSERT_EQ(found.keypoints.size(), 1U);
  const Keypoint& k = found.keypoints[0];
  ASSERT_TRUE(found.maps);
  const FeatureMap fine{found.maps->values[0].ptr<float>(), 16, 12, 4, 4};
  const FeatureMap coarse{found.maps->values[1].ptr<float>(), 8, 6, 1, 8};
  const cv::Mat cell = image(cv::Rect(24, 16, 4, 4)), block = image(cv::Rect(24, 16, 8, 8));
  EXPECT_NEAR(fine.data[(4 * 16 + 6) * 4], cv::mean(cell)[0] / 255, 1e-5);
  EXPECT_NEAR(coarse.data[2 * 8 + 3], cv::mean(block)[0] / 255, 1e-5);
  Eigen::RowVector4f expected;
  float mean = 0;
  SampleAtKeypoints(fine, {&k, 1}, true, expected.data(), 4);
  SampleAtKeypoints(coarse, {&k, 1}, true, &mean, 1);
  expected[0] += mean;
  EXPECT_TRUE(found.descriptors.row(0).isApprox(expected.normalized(), 1e-4F));
}

// A pack as others make them: one dense map of descriptors and a plane of scores.
TEST(PlNet, TakesDenseDescriptorsInPlanes) {
  FeatureNetworkSpec spec = Spec();
  spec.network.path = kData + std::string("/planes.onnx");
  spec.layout = MapLayout::kPlanes;
  spec.score_stride = 1;
  spec.maps = {{"descriptors", 4, 4}};
  spec.descriptor_head.reset();
  spec.lines.reset();
  cv::Mat noise(45, 61, CV_8UC1);
  cv::RNG(8).fill(noise, cv::RNG::UNIFORM, 0, 256);
  const Detections dense = PlNet(spec, ExactLoader()).Detect(noise, cv::Mat(), 20);
  // The same features in cells, and without the head's addition.
  spec = Spec();
  const Detections cells = PlNet(spec, ExactLoader()).Detect(noise, cv::Mat(), 20);
  ASSERT_EQ(dense.keypoints.size(), 20U);
  ASSERT_EQ(cells.keypoints.size(), 20U);
  for (std::size_t i = 0; i < 20; ++i) {
    EXPECT_NEAR(dense.keypoints[i].x, cells.keypoints[i].x, 1e-4);
    EXPECT_NEAR(dense.keypoints[i].y, cells.keypoints[i].y, 1e-4);
    const auto row = static_cast<Eigen::Index>(i);
    EXPECT_TRUE(dense.descriptors.row(row).tail(3).normalized().isApprox(
        cells.descriptors.row(row).tail(3).normalized(), 1e-3F));
  }
}

TEST(PlNet, RespectsTheMask) {
  PlNet plnet(Spec(), ExactLoader());
  const cv::Mat image = Dots({64, 48}, {{40, 12}, {10, 20}, {25, 30}});
  cv::Mat mask(48, 64, CV_8UC1, cv::Scalar(255));
  mask.at<std::uint8_t>(12, 40) = 0;
  const Detections found = plnet.Detect(image, mask, 10);
  ASSERT_EQ(found.keypoints.size(), 2U);
  EXPECT_NEAR(found.keypoints[0].x, 10, 1e-3);
}

TEST(PlNet, TheEdgeOfThePaddingIsNoFeature) {
  PlNet plnet(Spec(), ExactLoader());
  // A bright last column: with zeros as padding it would be a row of dots.
  cv::Mat image(45, 61, CV_8UC1, cv::Scalar(100));
  EXPECT_TRUE(plnet.Detect(image, cv::Mat(), 10).keypoints.empty());
  image.col(60) = 255;
  image.row(44) = 255;
  EXPECT_TRUE(plnet.Detect(image, cv::Mat(), 10).keypoints.empty());
}

TEST(PlNet, HandlesSeveralImageSizes) {
  PlNet plnet(Spec(), ExactLoader());
  for (int round = 0; round < 2; ++round) {
    for (const int width : {32, 48, 64, 80, 96, 112}) {
      const Detections found = plnet.Detect(Dots({width, 40}, {{20, 12}}), cv::Mat(), 10);
      ASSERT_EQ(found.keypoints.size(), 1U) << width;
      EXPECT_NEAR(found.keypoints[0].x, 20, 1e-3);
    }
  }
}

TEST(PlNet, TheResultDependsOnTheArgumentsOnly) {
  PlNet plnet(Spec(), UsualLoader());
  cv::Mat noise(96, 128, CV_8UC1);
  cv::RNG(5).fill(noise, cv::RNG::UNIFORM, 0, 256);
  const Detections first = plnet.Detect(noise, cv::Mat(), 50);
  plnet.Detect(Dots({128, 96}, {{20, 12}}), cv::Mat(), 10);
  const Detections second = plnet.Detect(noise, cv::Mat(), 50);
  ASSERT_EQ(first.keypoints.size(), 50U);
  ASSERT_EQ(second.keypoints.size(), 50U);
  for (std::size_t i = 0; i < 50; ++i) {
    EXPECT_EQ(first.keypoints[i].x, second.keypoints[i].x);
    EXPECT_EQ(first.keypoints[i].y, second.keypoints[i].y);
    EXPECT_EQ(first.keypoints[i].score, second.keypoints[i].score);
  }
  EXPECT_EQ(first.descriptors, second.descriptors);
}

TEST(PlNet, TwoInstancesRunSideBySide) {
  cv::Mat noise(96, 128, CV_8UC1);
  cv::RNG(6).fill(noise, cv::RNG::UNIFORM, 0, 256);
  const FeatureNetworkSpec spec = Spec();
  const DescriptorMatrix alone =
      PlNet(spec, UsualLoader()).Detect(noise, cv::Mat(), 50).descriptors;
  std::vector<DescriptorMatrix> results(2);
  {
    std::vector<std::jthread> threads;
    for (DescriptorMatrix& result : results) {
      threads.emplace_back([&] {
        PlNet plnet(spec, UsualLoader());
        for (int i = 0; i < 20; ++i) result = plnet.Detect(noise, cv::Mat(), 50).descriptors;
      });
    }
  }
  EXPECT_EQ(results[0], alone);
  EXPECT_EQ(results[1], alone);
}

TEST(PlNet, RefusesWhatItCannotTake) {
  PlNet plnet(Spec(), ExactLoader());
  EXPECT_THROW(plnet.Detect(cv::Mat(), cv::Mat(), 10), Error);
  EXPECT_THROW(plnet.Detect(cv::Mat(48, 64, CV_8UC3), cv::Mat(), 10), Error);
  const cv::Mat image(48, 64, CV_8UC1, cv::Scalar(0));
  EXPECT_THROW(plnet.Detect(image, cv::Mat(48, 32, CV_8UC1), 10), Error);
  FeatureNetworkSpec spec = Spec();
  spec.descriptor_size = 64;  // the head gives fewer
  EXPECT_THROW(PlNet(spec, ExactLoader()).Detect(image, cv::Mat(), 10), Error);
  spec = Spec();
  spec.maps[1].channels = 2;
  EXPECT_THROW(PlNet(spec, ExactLoader()).Detect(image, cv::Mat(), 10), Error);
  spec = Spec();
  spec.scores = "heat";
  EXPECT_THROW(PlNet(spec, ExactLoader()).Detect(image, cv::Mat(), 10), Error);
}

// The test network reads its maps from the image: cells of 255 are junctions, those of about 128
// say that there is a line above them.
cv::Mat DrawnLine(cv::Size cells, int row, int left, int right) {
  cv::Mat maps(cells, CV_8UC1, cv::Scalar(0));
  for (int column = left + 1; column < right; ++column) maps.at<std::uint8_t>(row, column) = 128;
  maps.at<std::uint8_t>(row, left) = maps.at<std::uint8_t>(row, right) = 255;
  cv::Mat image;
  cv::resize(maps, image, {}, 4, 4, cv::INTER_NEAREST);
  return image;
}

// The mean of 8x8 blocks of an image, interpolated at a pixel; grey as 0..1.
double BilinearAtBlocks(const cv::Mat& image, double x, double y) {
  cv::Mat blocks;
  cv::resize(image, blocks, {}, 0.125, 0.125, cv::INTER_AREA);
  const double u = (x + 0.5) / 8 - 0.5, v = (y + 0.5) / 8 - 0.5;
  const int column = static_cast<int>(u), row = static_cast<int>(v);
  const auto at = [&](int r, int c) { return blocks.at<std::uint8_t>(r, c) / 255.0; };
  const double a = u - column, b = v - row;
  return (1 - b) * ((1 - a) * at(row, column) + a * at(row, column + 1)) +
         b * ((1 - a) * at(row + 1, column) + a * at(row + 1, column + 1));
}

TEST(PlNet, FindsLinesInTheSamePass) {
  PlNet plnet(Spec(), ExactLoader());
  EXPECT_TRUE(plnet.finds_lines());
  const cv::Mat image = DrawnLine({16, 12}, 5, 4, 8);
  const Detections found = plnet.Detect(image, cv::Mat(), {10, true, 0.5F});
  ASSERT_EQ(found.lines.size(), 1U);
  const LineSegment& line = found.lines[0];
  EXPECT_NEAR(line.x1, 17.5, 1e-3);
  EXPECT_NEAR(line.y1, 21.5, 1e-3);
  EXPECT_NEAR(line.x2, 33.5, 1e-3);
  EXPECT_NEAR(line.y2, 21.5, 1e-3);
  // The four samples lie in junctions and between drawn cells; of the coarse ones along the line
  // the last counts.
  const double mean = (2 + 2 * 128.0 / 255) / 4;
  // Of those about the ends the last counts: 2 pixels before the end.
  const double coarse =
      BilinearAtBlocks(image, 33.5, 21.5) + 0.5 * BilinearAtBlocks(image, 31.5, 21.5);
  EXPECT_NEAR(line.score, 1 / (1 + std::exp(1 - 4 * mean - coarse)), 1e-4);
  ASSERT_EQ(found.junctions.size(), 2U);
  ASSERT_EQ(found.line_ends.size(), 1U);
  EXPECT_EQ(found.junctions[static_cast<std::size_t>(found.line_ends[0].end)].x, line.x2);
  EXPECT_EQ(found.junction_descriptors.rows(), 2);
  EXPECT_NEAR(found.junction_descriptors.row(1).norm(), 1, 1e-5);
  const Detections plain = plnet.Detect(image, cv::Mat(), 10);
  EXPECT_TRUE(plain.lines.empty());
  EXPECT_EQ(plain.keypoints.size(), found.keypoints.size());
  EXPECT_EQ(plain.descriptors, found.descriptors);
  EXPECT_TRUE(plnet.Detect(image, cv::Mat(), {10, true, 0.99F}).lines.empty());
}

TEST(PlNet, FindsLinesLaterInMapsThatWereKept) {
  PlNet first(Spec(), ExactLoader());
  const cv::Mat image = DrawnLine({16, 12}, 5, 4, 8);
  const Detections at_once = first.Detect(image, cv::Mat(), {10, true, 0.5F});
  EXPECT_FALSE(at_once.maps);
  DetectionRequest request(10);
  request.keep_maps = true;
  const Detections seen = first.Detect(image, cv::Mat(), request);
  ASSERT_TRUE(seen.maps);
  first.Detect(DrawnLine({16, 12}, 3, 2, 9), cv::Mat(), request);  // its memory is another
  const Detections later =
      PlNet(Spec(), ExactLoader()).FindLines(image, cv::Mat(), seen, {10, true, 0.5F});
  ASSERT_EQ(later.lines.size(), at_once.lines.size());
  EXPECT_EQ(later.lines[0].x1, at_once.lines[0].x1);
  EXPECT_EQ(later.lines[0].score, at_once.lines[0].score);
  EXPECT_EQ(later.junction_descriptors, at_once.junction_descriptors);
  EXPECT_TRUE(later.keypoints.empty());
  // Without maps the image is looked at anew.
  const Detections again = first.FindLines(image, cv::Mat(), {}, {10, true, 0.5F});
  ASSERT_EQ(again.lines.size(), 1U);
  EXPECT_EQ(again.lines[0].score, at_once.lines[0].score);
  EXPECT_THROW(first.FindLines(image.colRange(0, 48), cv::Mat(), seen, {10, true}), Error);
}

// Many lines of one length below each other, more than the classifier judges at once.
TEST(PlNet, JudgesAsManyProposalsAsAreAskedFor) {
  constexpr int kLines = 300;
  cv::Mat image;
  for (int i = 0; i < kLines; ++i) image.push_back(DrawnLine({16, 12}, 5, 4, 8));
  FeatureNetworkSpec spec = Spec();
  spec.lines->decoder.max_junctions = spec.lines->decoder.max_proposals = 4 * kLines;
  PlNet plnet(spec, ExactLoader());
  DetectionRequest request(0, true, 0.5F);
  request.max_junctions = request.max_line_proposals = 4 * kLines;
  const Detections all = plnet.Detect(image, cv::Mat(), request);
  ASSERT_EQ(all.lines.size(), std::size_t{kLines});
  for (const LineSegment& line : all.lines) EXPECT_NEAR(line.score, all.lines[0].score, 1e-5);
  request.max_line_proposals = 7;
  EXPECT_EQ(plnet.Detect(image, cv::Mat(), request).lines.size(), 7U);
  request.max_line_proposals = 4 * kLines;
  request.max_junctions = 2;
  EXPECT_LE(plnet.Detect(image, cv::Mat(), request).lines.size(), 1U);
  request.max_junctions = 1;
  EXPECT_THROW(plnet.Detect(image, cv::Mat(), request), Error);
}

TEST(PlNet, LinesKeepOutOfTheMask) {
  PlNet plnet(Spec(), ExactLoader());
  const cv::Mat image = DrawnLine({16, 12}, 5, 4, 8);
  cv::Mat mask(image.size(), CV_8UC1, cv::Scalar(255));
  mask.colRange(36, 64) = 0;
  const Detections found = plnet.Detect(image, mask, {10, true, 0.0F});
  EXPECT_TRUE(found.lines.empty());
  EXPECT_TRUE(found.junctions.empty());
}

TEST(PlNet, WithoutALineModuleThereAreNoLines) {
  FeatureNetworkSpec spec = Spec();
  spec.lines.reset();
  PlNet plnet(spec, ExactLoader());
  EXPECT_FALSE(plnet.finds_lines());
  EXPECT_TRUE(plnet.Detect(DrawnLine({16, 12}, 5, 4, 8), cv::Mat(), {10, true}).lines.empty());
}

TEST(PlNet, RefusesALineModuleThatDoesNotFit) {
  const cv::Mat image = DrawnLine({16, 12}, 5, 4, 8);
  FeatureNetworkSpec spec = Spec();
  spec.lines->pooled[0].map.channels = 3;
  EXPECT_THROW(PlNet(spec, ExactLoader()).Detect(image, cv::Mat(), {10, true}), Error);
  EXPECT_NO_THROW(PlNet(spec, ExactLoader()).Detect(image, cv::Mat(), 10));
  spec = Spec();
  spec.lines->pooled[1].samples = 5;  // the classifier takes another number of features
  EXPECT_THROW(PlNet(spec, ExactLoader()).Detect(image, cv::Mat(), {10, true}), Error);
  spec = Spec();
  spec.lines->pooled[1].end_offsets.clear();
  EXPECT_THROW(PlNet(spec, ExactLoader()).Detect(image, cv::Mat(), {10, true}), Error);
  spec = Spec();
  spec.lines->decoder.snap = -1;
  EXPECT_THROW(PlNet(spec, ExactLoader()), Error);
}

TEST(NormalizeImage, UnitAndPadding) {
  cv::Mat image = (cv::Mat_<std::uint8_t>(2, 3) << 0, 51, 255, 102, 0, 204);
  std::vector<float> out(5 * 4, -1);
  NormalizeImage(image, Normalization::kUnit, 5, 4, out.data());
  const std::vector<float> last = {0.4F, 0, 0.8F, 0.8F, 0.8F};
  std::vector<float> expected = {0, 0.2F, 1, 1, 1};
  for (int i = 0; i < 3; ++i) expected.insert(expected.end(), last.begin(), last.end());
  EXPECT_THAT(out, testing::Pointwise(testing::FloatNear(1e-6F), expected));
}

TEST(NormalizeImage, StandardizeIgnoresLightAndPadding) {
  cv::Mat image(40, 50, CV_8UC1);
  cv::RNG(1).fill(image, cv::RNG::UNIFORM, 50, 90);
  cv::Mat brighter = image * 2 + 20;
  std::vector<float> a(64 * 48), b(64 * 48);
  NormalizeImage(image, Normalization::kStandardize, 64, 48, a.data());
  NormalizeImage(brighter, Normalization::kStandardize, 64, 48, b.data());
  EXPECT_THAT(a, testing::Pointwise(testing::FloatNear(1e-4F), b));
  double sum = 0, squares = 0;  // over the image, without the padding
  for (int y = 0; y < 40; ++y) {
    for (int x = 0; x < 50; ++x) {
      const double v = a[static_cast<std::size_t>(y * 64 + x)];
      sum += v;
      squares += v * v;
    }
  }
  EXPECT_NEAR(sum / 2000, 0, 1e-5);
  EXPECT_NEAR(squares / 2000, 1, 1e-4);
}

TEST(NormalizeImage, StandardizeDoesNotStretchNoise) {
  cv::Mat dark(2, 2, CV_8UC1, cv::Scalar(10));
  dark.at<std::uint8_t>(0, 0) = 12;  // mean 10.5, standard deviation 0.87 < 2
  std::vector<float> out(4);
  NormalizeImage(dark, Normalization::kStandardize, 2, 2, out.data());
  EXPECT_NEAR(out[0], 1.5 / 2, 1e-6);
  EXPECT_NEAR(out[3], -0.5 / 2, 1e-6);
}

}  // namespace
}  // namespace airslam
