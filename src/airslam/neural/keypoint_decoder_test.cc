// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/neural/keypoint_decoder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <set>
#include <tuple>

#include "airslam/common/error.h"

namespace airslam {
namespace {

// A map with a rim of extra columns, as the padded network's output has.
struct TestMap {
  TestMap(int w, int h, float fill = -10)
      : width(w), height(h), stride(w + 5), values(static_cast<std::size_t>(stride * h), fill) {}
  float& at(int x, int y) { return values[static_cast<std::size_t>(y * stride + x)]; }
  ScoreMap view() const { return {values.data(), width, height, stride}; }

  int width, height, stride;
  std::vector<float> values;
};

TestMap RandomMap(int width, int height, unsigned seed, int levels) {
  std::mt19937 random(seed);
  TestMap map(width, height);
  // The rim is higher than everything: reading it as part of the image would show.
  std::fill(map.values.begin(), map.values.end(), 100.0F);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      map.at(x, y) = static_cast<float>(random() % static_cast<unsigned>(levels)) * 20.0F /
                         static_cast<float>(levels) -
                     12.0F;
    }
  }
  return map;
}

// The definition in the header, word by word.
std::vector<Keypoint> NaiveDecode(TestMap map, const cv::Mat& mask,
                                  const KeypointDecoderOptions& options) {
  std::vector<Keypoint> found;
  const int r = options.nms_radius, margin = std::max(options.border, r);
  for (int y = margin; y < map.height - margin; ++y) {
    for (int x = margin; x < map.width - margin; ++x) {
      bool keep = map.at(x, y) > options.score_threshold;
      for (int v = y - r; v <= y + r; ++v) {
        for (int u = x - r; u <= x + r; ++u) {
          const bool earlier = std::tie(v, u) < std::tie(y, x);
          keep = keep && map.at(u, v) <= map.at(x, y) && !(earlier && map.at(u, v) == map.at(x, y));
        }
      }
      for (const int v : {y - options.border, y, y + options.border}) {
        for (const int u : {x - options.border, x, x + options.border}) {
          keep = keep && (mask.empty() || mask.at<std::uint8_t>(v, u) != 0);
        }
      }
      if (keep) found.push_back({static_cast<float>(x), static_cast<float>(y), map.at(x, y)});
    }
  }
  std::stable_sort(found.begin(), found.end(),
                   [](const Keypoint& a, const Keypoint& b) { return a.score > b.score; });
  if (found.size() > static_cast<std::size_t>(options.max_keypoints)) {
    found.resize(static_cast<std::size_t>(options.max_keypoints));
  }
  return found;
}

void ExpectEqual(const std::vector<Keypoint>& a, const std::vector<Keypoint>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    ASSERT_EQ(std::tie(a[i].x, a[i].y, a[i].score), std::tie(b[i].x, b[i].y, b[i].score)) << i;
  }
}

TEST(KeypointDecoder, AgreesWithItsDefinition) {
  // Few levels make many ties; widths that are no multiple of four exercise the ends of rows.
  for (const auto& [width, height, levels, radius, border] : {std::tuple{64, 48, 1000000, 2, 4},
                                                              {61, 47, 9, 2, 4},
                                                              {50, 33, 5, 1, 4},
                                                              {67, 40, 30, 5, 4},
                                                              {43, 31, 12, 3, 1}}) {
    for (const int count : {100000, 7}) {
      const TestMap map = RandomMap(width, height, static_cast<unsigned>(width), levels);
      KeypointDecoderOptions options;
      options.nms_radius = radius;
      options.border = border;
      options.max_keypoints = count;
      options.spread = 0;
      options.subpixel = false;
      const std::vector<Keypoint> expected = NaiveDecode(map, cv::Mat(), options);
      EXPECT_GT(expected.size(), 6U);
      ExpectEqual(DecodeKeypoints(map.view(), cv::Mat(), options), expected);
      cv::Mat mask(height, width, CV_8UC1, cv::Scalar(255));
      mask(cv::Rect(0, 0, width / 2, height / 2)).setTo(0);
      const std::vector<Keypoint> masked = DecodeKeypoints(map.view(), mask, options);
      ExpectEqual(masked, NaiveDecode(map, mask, options));
      for (const Keypoint& k : masked) {
        EXPECT_NE(mask.at<std::uint8_t>(static_cast<int>(k.y), static_cast<int>(k.x)), 0);
      }
    }
  }
}

TEST(KeypointDecoder, FindsTheVertexOfAQuadraticPeak) {
  const float true_x = 20.3F, true_y = 15.6F;
  TestMap map(40, 30);
  for (int y = 0; y < 30; ++y) {
    for (int x = 0; x < 40; ++x) {
      const float dx = static_cast<float>(x) - true_x, dy = static_cast<float>(y) - true_y;
      map.at(x, y) = 3 - 0.5F * (dx * dx + 0.6F * dx * dy + 0.7F * dy * dy);  // a tilted ellipse
    }
  }
  const std::vector<Keypoint> found = DecodeKeypoints(map.view(), cv::Mat(), {});
  ASSERT_EQ(found.size(), 1U);
  EXPECT_NEAR(found[0].x, true_x, 1e-3);
  EXPECT_NEAR(found[0].y, true_y, 1e-3);
  EXPECT_EQ(found[0].score, map.at(20, 16));
}

TEST(KeypointDecoder, StaysWithinHalfAPixel) {
  const TestMap map = RandomMap(80, 60, 3, 20);
  KeypointDecoderOptions options;
  options.max_keypoints = 100000;
  const std::vector<Keypoint> refined = DecodeKeypoints(map.view(), cv::Mat(), options);
  options.subpixel = false;
  const std::vector<Keypoint> pixels = DecodeKeypoints(map.view(), cv::Mat(), options);
  ASSERT_EQ(refined.size(), pixels.size());
  int moved = 0;
  for (std::size_t i = 0; i < refined.size(); ++i) {
    EXPECT_LE(std::abs(refined[i].x - pixels[i].x), 0.5F);
    EXPECT_LE(std::abs(refined[i].y - pixels[i].y), 0.5F);
    moved += refined[i].x != pixels[i].x ? 1 : 0;
  }
  EXPECT_GT(moved, static_cast<int>(refined.size()) / 2);
}

// Strong peaks crowd the left quarter, weak ones lie everywhere.
TestMap CrowdedMap() {
  TestMap map(512, 256);
  for (int y = 8; y < 248; y += 8) {
    for (int x = 8; x < 504; x += 8) {
      map.at(x, y) = x < 128 ? 5.0F + 0.001F * static_cast<float>(x + y) : -2.0F;
    }
  }
  return map;
}

TEST(KeypointDecoder, SpreadGivesEveryCellItsShare) {
  const TestMap map = CrowdedMap();
  KeypointDecoderOptions options;
  options.max_keypoints = 128;
  options.cell_size = 64;  // 8 x 4 cells
  const auto right = [](const std::vector<Keypoint>& keypoints) {
    return std::count_if(keypoints.begin(), keypoints.end(),
                         [](const Keypoint& k) { return k.x >= 128; });
  };
  options.spread = 0;
  EXPECT_EQ(right(DecodeKeypoints(map.view(), cv::Mat(), options)), 0);
  options.spread = 0.5F;
  const std::vector<Keypoint> spread = DecodeKeypoints(map.view(), cv::Mat(), options);
  EXPECT_EQ(spread.size(), 128U);
  EXPECT_EQ(right(spread), 24 * 2);  // two for each of the 24 cells of the right three quarters
  EXPECT_TRUE(
      std::is_sorted(spread.begin(), spread.end(),
                     [](const Keypoint& a, const Keypoint& b) { return a.score > b.score; }));
  std::set<std::pair<float, float>> places;
  for (const Keypoint& k : spread) places.emplace(k.x, k.y);
  EXPECT_EQ(places.size(), spread.size());
}

TEST(KeypointDecoder, SpreadFillsUpWithTheBestWhenCellsAreEmpty) {
  TestMap map(512, 256);
  for (int i = 0; i < 30; ++i) map.at(10 + 3 * i, 20) = static_cast<float>(i);
  KeypointDecoderOptions options;
  options.max_keypoints = 20;
  options.spread = 1;
  const std::vector<Keypoint> found = DecodeKeypoints(map.view(), cv::Mat(), options);
  ASSERT_EQ(found.size(), 20U);
  EXPECT_EQ(found.front().score, 29);
  EXPECT_EQ(found.back().score, 10);
}

TEST(KeypointDecoder, NanIsNoKeypoint) {
  TestMap map(32, 32);
  map.at(10, 10) = std::numeric_limits<float>::quiet_NaN();
  map.at(20, 20) = 1;
  const std::vector<Keypoint> found = DecodeKeypoints(map.view(), cv::Mat(), {});
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].score, 1);
}

TEST(KeypointDecoder, ImagesSmallerThanTheMarginHoldNothing) {
  for (const int size : {1, 4, 8}) {
    const TestMap map(size, size, 1);
    EXPECT_TRUE(DecodeKeypoints(map.view(), cv::Mat(), {}).empty());
  }
}

TEST(KeypointDecoder, RefusesBadArguments) {
  const TestMap map(32, 32);
  EXPECT_THROW(DecodeKeypoints(map.view(), cv::Mat(16, 32, CV_8UC1), {}), Error);
  EXPECT_THROW(DecodeKeypoints(map.view(), cv::Mat(32, 32, CV_32FC1), {}), Error);
  KeypointDecoderOptions options;
  options.spread = 1.5F;
  EXPECT_THROW(options.Validate(), Error);
  options = {};
  options.nms_radius = 0;
  EXPECT_THROW(options.Validate(), Error);
  options = {};
  options.border = 0;
  EXPECT_THROW(options.Validate(), Error);
  options = {};
  options.cell_size = 1;
  EXPECT_THROW(options.Validate(), Error);
  options = {};
  options.max_keypoints = -1;
  EXPECT_THROW(options.Validate(), Error);
}

}  // namespace
}  // namespace airslam
