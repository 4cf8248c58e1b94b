// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/neural/line_decoder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>

#include "airslam/common/error.h"
#include "airslam/neural/map_sampling.h"

namespace airslam {
namespace {

constexpr float kOff = -9;  // a logit of nothing there
constexpr double kHalfPi = std::numbers::pi / 2;

float Logit(double p) { return static_cast<float>(std::log(p / (1 - p))); }

// Maps that can be written to.
class Maps {
 public:
  Maps(int width, int height)
      : width_(width), height_(height), field_(6 * Size(), 0.0F), junctions_(3 * Size(), 0.0F) {
    std::fill_n(field_.begin(), Size(), kOff);
    std::fill_n(junctions_.begin(), Size(), kOff);
  }

  // Says "segment p q" at a cell, as the paper's equations encode it.
  void SetLine(int row, int column, cv::Point2d p, cv::Point2d q, float confidence = 3) {
    const cv::Point2d cell(4 * column + 1.5, 4 * row + 1.5);
    const cv::Point2d along = (q - p) / cv::norm(q - p);
    const cv::Point2d foot = p + along * (cell - p).dot(along);
    const double d = cv::norm(foot - cell);
    const cv::Point2d normal = (foot - cell) / d;
    const cv::Point2d turned(-normal.y, normal.x);  // where theta_i > 0
    double reach1 = (p - foot).dot(turned), reach2 = (q - foot).dot(turned);
    if (reach1 < reach2) std::swap(reach1, reach2);
    Field(0, row, column) = confidence;
    Field(1, row, column) = Logit(d / 16);
    Field(2, row, column) = static_cast<float>(2.5 * normal.x);  // any length will do
    Field(3, row, column) = static_cast<float>(2.5 * normal.y);
    Field(4, row, column) = Logit(std::atan(reach1 / d) / kHalfPi);
    Field(5, row, column) = Logit(std::atan(-reach2 / d) / kHalfPi);
  }

  void SetJunction(double x, double y, float logit) {
    const int column = static_cast<int>(std::lround((x - 1.5) / 4));
    const int row = static_cast<int>(std::lround((y - 1.5) / 4));
    Junction(0, row, column) = logit;
    Junction(1, row, column) = static_cast<float>(std::atanh(2 * ((x - 1.5) / 4 - column)));
    Junction(2, row, column) = static_cast<float>(std::atanh(2 * ((y - 1.5) / 4 - row)));
  }

  float& Field(int plane, int row, int column) { return field_[Index(plane, row, column)]; }
  float& Junction(int plane, int row, int column) { return junctions_[Index(plane, row, column)]; }

  LineMaps view() const { return {field_.data(), junctions_.data(), width_, height_}; }
  cv::Size image_size() const { return {4 * width_, 4 * height_}; }

 private:
  std::size_t Size() const {
    return static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_);
  }
  std::size_t Index(int plane, int row, int column) const {
    return static_cast<std::size_t>((plane * height_ + row) * width_ + column);
  }

  int width_, height_;
  std::vector<float> field_, junctions_;
};

std::vector<Keypoint> JunctionsOf(const Maps& maps, const cv::Mat& mask = {},
                                  const LineDecoderOptions& options = {}) {
  return FindJunctions(maps.view(), maps.image_size(), mask, options);
}

TEST(DecodeLine, AnExactFieldGivesTheExactSegment) {
  Maps maps(40, 30);
  const std::vector<std::array<cv::Point2d, 2>> segments = {
      {{{20.3, 40.7}, {130.1, 60.2}}}, {{{80, 10.5}, {77, 110}}}, {{{10, 15}, {60, 100}}}};
  for (const auto& [p, q] : segments) {
    const cv::Point2d middle = (p + q) / 2;
    for (const int step : {-2, 1, 3}) {  // cells on both sides
      const int row = static_cast<int>(middle.y / 4) + step;
      const int column = static_cast<int>(middle.x / 4) + step;
      maps.SetLine(row, column, p, q);
      const std::array<float, 4> line = DecodeLine(maps.view(), {}, row, column);
      const cv::Point2d first(line[0], line[1]), second(line[2], line[3]);
      const bool same = cv::norm(first - p) < cv::norm(first - q);
      EXPECT_NEAR(cv::norm(first - (same ? p : q)), 0, 0.01);
      EXPECT_NEAR(cv::norm(second - (same ? q : p)), 0, 0.01);
    }
  }
}

TEST(FindJunctions, BestFirstAtSubPixelPlaces) {
  Maps maps(20, 15);
  maps.SetJunction(30.2, 21.1, 1);
  maps.SetJunction(60.9, 40.3, 2);
  maps.Junction(0, 5, 8) = 0.5F;  // beside the first and weaker
  maps.SetJunction(70, 50, Logit(0.01));
  const std::vector<Keypoint> found = JunctionsOf(maps);
  ASSERT_EQ(found.size(), 2U);
  EXPECT_NEAR(found[0].x, 60.9, 1e-3);
  EXPECT_NEAR(found[0].y, 40.3, 1e-3);
  EXPECT_NEAR(found[0].score, 1 / (1 + std::exp(-2)), 1e-6);
  EXPECT_NEAR(found[1].x, 30.2, 1e-3);
  LineDecoderOptions options;
  options.max_junctions = 2;
  maps.SetJunction(10, 10, 3);
  EXPECT_EQ(JunctionsOf(maps, {}, options).size(), 2U);
  EXPECT_NEAR(JunctionsOf(maps, {}, options)[0].x, 10, 1e-3);
}

TEST(FindJunctions, StayInTheImageAndOutOfTheMask) {
  Maps maps(20, 15);
  maps.SetJunction(79, 30, 2);  // in the padding of an image of 75x60
  maps.SetJunction(20, 30, 1);
  const std::vector<Keypoint> found = FindJunctions(maps.view(), {75, 60}, cv::Mat(), {});
  ASSERT_EQ(found.size(), 2U);
  EXPECT_EQ(found[0].x, 74);
  cv::Mat mask(60, 75, CV_8UC1, cv::Scalar(255));
  mask.colRange(23, 75) = 0;  // within the border of 4 pixels of (20, 30)
  EXPECT_TRUE(FindJunctions(maps.view(), {75, 60}, mask, {}).empty());
  mask.colRange(23, 26) = 255;
  EXPECT_EQ(FindJunctions(maps.view(), {75, 60}, mask, {}).size(), 1U);
}

// Three junctions; four cells vote for the line between two of them, one for another.
Maps Triangle() {
  Maps maps(40, 30);
  const cv::Point2d a(20, 60), b(120, 30), c(110, 100);
  maps.SetJunction(a.x, a.y, 3);
  maps.SetJunction(b.x, b.y, 2);
  maps.SetJunction(c.x, c.y, 1);
  const cv::Point2d shift(3, -2);  // what the field says is not exact
  for (const int column : {12, 15, 18, 21}) {
    const int row = static_cast<int>((60 - 0.3 * (4 * column - 20)) / 4) + 1;
    maps.SetLine(row, column, a + shift, b - shift, 1);
  }
  maps.SetLine(20, 20, c, a, 2);
  return maps;
}

TEST(ProposeLines, SnapsAndCountsVotes) {
  const Maps maps = Triangle();
  const std::vector<Keypoint> junctions = JunctionsOf(maps);
  ASSERT_EQ(junctions.size(), 3U);
  const std::vector<LineProposal> lines = ProposeLines(maps.view(), junctions, {}, {});
  ASSERT_EQ(lines.size(), 2U);
  EXPECT_EQ(lines[0].start, 0);
  EXPECT_EQ(lines[0].end, 1);
  const double length = std::hypot(100, 30);
  EXPECT_NEAR(lines[0].extras[0], std::log(5) / 4, 1e-5);
  EXPECT_NEAR(lines[0].extras[1], 4 / (length / 4 + 1) / 4, 1e-5);
  EXPECT_NEAR(lines[0].extras[2], 2 * std::hypot(3, 2) / 24, 1e-3);
  EXPECT_NEAR(lines[0].extras[3], 1 / (1 + std::exp(-1)), 1e-5);
  EXPECT_EQ(lines[0].extras[4], junctions[0].score);
  EXPECT_EQ(lines[0].extras[5], junctions[1].score);
  EXPECT_NEAR(lines[0].extras[6], length / 256, 1e-5);
  EXPECT_NEAR(lines[0].extras[7], std::log(length + 1) / 4, 1e-5);
  EXPECT_LT(lines[0].extras[8], 0.5);  // four cells do not support it
  EXPECT_EQ(lines[1].start, 0);        // the left one first
  EXPECT_EQ(lines[1].end, 2);
  EXPECT_NEAR(lines[1].extras[2], 0, 1e-3);
  LineDecoderOptions one;
  one.max_proposals = 1;
  EXPECT_EQ(ProposeLines(maps.view(), junctions, {}, one).size(), 1U);
}

TEST(ProposeLines, SupportIsEnough) {
  Maps maps(60, 30);
  const cv::Point2d p(20, 60), q(220, 64);
  maps.SetJunction(p.x, p.y, 2);
  maps.SetJunction(q.x, q.y, 2);
  // Cells along it know the line, but the ends they name are 30 pixels around them.
  const cv::Point2d along = (q - p) / cv::norm(q - p);
  for (int column = 4; column < 56; ++column) {
    const cv::Point2d foot = p + along * (4 * column - 20);
    for (const int row : {13, 14, 16, 17}) {
      maps.SetLine(row, column, foot - along * 30, foot + along * 30, 1);
    }
  }
  const std::vector<Keypoint> junctions = JunctionsOf(maps);
  ASSERT_EQ(junctions.size(), 2U);
  EXPECT_EQ(LineSupport(maps.view(), junctions[0], junctions[1], {}), 1);
  const std::vector<LineProposal> lines = ProposeLines(maps.view(), junctions, {}, {});
  ASSERT_EQ(lines.size(), 1U);
  EXPECT_EQ(lines[0].extras[0], 0);  // no vote
  EXPECT_EQ(lines[0].extras[2], 2);
  EXPECT_EQ(lines[0].extras[8], 1);
  // Across the line there is none.
  EXPECT_EQ(LineSupport(maps.view(), {100, 30, 1}, {104, 90, 1}, {}), 0);
  EXPECT_EQ(LineSupport(maps.view(), {100, 30, 1}, {100, 30, 1}, {}), 0);
}

TEST(ProposeLines, EndsFarFromJunctionsProposeNothing) {
  const Maps maps = Triangle();
  LineDecoderOptions options;
  options.snap = 3;
  EXPECT_EQ(ProposeLines(maps.view(), JunctionsOf(maps), {}, options).size(), 1U);
  EXPECT_TRUE(ProposeLines(maps.view(), {}, {}, {}).empty());
  EXPECT_TRUE(ProposeLines(Maps(40, 30).view(), JunctionsOf(maps), {}, {}).empty());
  Maps broken = Triangle();
  for (int k = 1; k < 6; ++k) {
    broken.Field(k, 20, 20) = std::numeric_limits<float>::quiet_NaN();
  }
  EXPECT_EQ(ProposeLines(broken.view(), JunctionsOf(maps), {}, {}).size(), 1U);
}

TEST(ProposeLines, MaskedPixelsAreNotCrossed) {
  const Maps maps = Triangle();
  cv::Mat mask(120, 160, CV_8UC1, cv::Scalar(255));
  mask(cv::Rect(60, 30, 20, 30)) = 0;  // on the way from the first junction to the second
  const std::vector<LineProposal> lines =
      ProposeLines(maps.view(), JunctionsOf(maps, mask), mask, {});
  ASSERT_EQ(lines.size(), 1U);
  EXPECT_EQ(lines[0].end, 2);
}

TEST(SuppressDoubles, LeavesTheSurest) {
  const std::vector<Keypoint> junctions = {{10, 10, 1}, {90, 10, 1}, {14, 12, 1}, {86, 16, 1}};
  // 0-1, nearly the same turned round, one that shares an end, and the first once more.
  const std::vector<LineProposal> proposals = {{0, 1}, {3, 2}, {0, 3}, {0, 1}};
  const std::vector<float> scores = {0.8F, 0.9F, 0.5F, 0.8F};
  // Squared distances: 1 to 0: 20 + 52, 2 to 1: 20 + 0.
  EXPECT_EQ(SuppressDoubles(junctions, proposals, scores, 8.4F, 0),
            (std::vector<float>{0.8F, 0.9F, -1, -1}));
  EXPECT_EQ(SuppressDoubles(junctions, proposals, scores, 8.5F, 0),
            (std::vector<float>{-1, 0.9F, -1, -1}));
  EXPECT_EQ(SuppressDoubles(junctions, proposals, scores, 0, 0), scores);
  EXPECT_EQ(SuppressDoubles(junctions, proposals, scores, 0, 0.8F),
            (std::vector<float>{0.8F, 0.9F, -1, 0.8F}));
  EXPECT_TRUE(SuppressDoubles(junctions, {}, {}, 10, 0).empty());
}

TEST(KeepLines, SortsAndKeepsTheirJunctions) {
  const std::vector<Keypoint> junctions = {{1, 2, 0.9F}, {3, 4, 0.8F}, {5, 6, 0.7F}, {7, 8, 0.6F}};
  const std::vector<LineProposal> proposals = {{0, 3}, {2, 3}, {0, 2}, {0, 1}};
  const std::vector<float> scores = {0.5F, 0.7F, 0.5F, std::numeric_limits<float>::quiet_NaN()};
  Detections found;
  KeepLines(junctions, proposals, scores, 0.5F, found);
  ASSERT_EQ(found.lines.size(), 3U);
  EXPECT_EQ(found.lines[0].score, 0.7F);
  EXPECT_EQ(found.lines[1].y2, 6);  // of equal scores the first junctions
  ASSERT_EQ(found.junctions.size(), 3U);
  EXPECT_EQ(found.junctions[2].x, 7);
  for (std::size_t i = 0; i < 3; ++i) {
    const LineEnds& ends = found.line_ends[i];
    EXPECT_EQ(found.lines[i].x1, found.junctions[static_cast<std::size_t>(ends.start)].x);
    EXPECT_EQ(found.lines[i].y2, found.junctions[static_cast<std::size_t>(ends.end)].y);
  }
  Detections none;
  KeepLines(junctions, {}, {}, 0, none);
  EXPECT_TRUE(none.lines.empty() && none.junctions.empty());
}

TEST(DiscountOverlaps, AGuessAtOtherEndsOfALineLosesWhatTheSurerOneHolds) {
  const std::vector<Keypoint> junctions = {{0, 0, 1},   {100, 0, 1}, {50, 2, 1},
                                           {150, 1, 1}, {0, 60, 1},  {100, 60, 1}};
  const std::vector<LineProposal> proposals = {{0, 1}, {0, 2}, {2, 3}, {4, 5}, {0, 5}, {1, 0}};
  const std::vector<float> scores = {0.8F, 0.5F, 0.4F, 0.9F, 0.3F, -1};
  const std::vector<float> discounted = DiscountOverlaps(junctions, proposals, scores, 8);
  EXPECT_EQ(discounted[0], 0.8F);  // of its line the surest
  EXPECT_NEAR(discounted[1], 0.5 * (1 - 0.8 * 0.5), 1e-3);
  // Half of it lies on the first, none on the second: 50 of 150 and 0.
  EXPECT_NEAR(discounted[2], 0.4 * (1 - 0.8 / 3), 1e-3);
  EXPECT_EQ(discounted[3], 0.9F);  // of the same direction, elsewhere
  EXPECT_EQ(discounted[4], 0.3F);  // across
  EXPECT_EQ(discounted[5], -1);
  EXPECT_EQ(DiscountOverlaps(junctions, proposals, scores, 0), scores);
  EXPECT_TRUE(DiscountOverlaps(junctions, {}, {}, 8).empty());
}

// Maps, and what training/airslam_training/lines.py makes of them (testdata/make_line_case.py).
TEST(LineDecoder, AgreesWithTheTrainingCode) {
  std::ifstream stream(AIRSLAM_SOURCE_DIR "/src/airslam/neural/testdata/line_case.json");
  const nlohmann::json data = nlohmann::json::parse(stream);
  const int width = data["width"], height = data["height"], channels = data["channels"];
  const auto field = data["field"].get<std::vector<float>>();
  const auto heat = data["junction_maps"].get<std::vector<float>>();
  const auto pooled = data["pooled"].get<std::vector<float>>();
  const LineMaps maps{field.data(), heat.data(), width, height};
  const cv::Size size(4 * width, 4 * height);
  const std::vector<Keypoint> junctions = FindJunctions(maps, size, {}, {});
  ASSERT_EQ(junctions.size(), data["junctions"].size());
  for (std::size_t i = 0; i < junctions.size(); ++i) {
    EXPECT_NEAR(junctions[i].x, data["junctions"][i][0].get<float>(), 1e-3);
    EXPECT_NEAR(junctions[i].y, data["junctions"][i][1].get<float>(), 1e-3);
    EXPECT_NEAR(junctions[i].score, data["junctions"][i][2].get<float>(), 1e-5);
  }
  const std::vector<LineProposal> lines = ProposeLines(maps, junctions, {}, {});
  ASSERT_EQ(lines.size(), data["proposals"].size());
  const int samples = data["samples"];
  std::vector<float> out(static_cast<std::size_t>(samples * channels));
  for (std::size_t i = 0; i < lines.size(); ++i) {
    EXPECT_EQ(lines[i].start, data["proposals"][i][0].get<int>());
    EXPECT_EQ(lines[i].end, data["proposals"][i][1].get<int>());
    EXPECT_THAT(lines[i].extras, testing::Pointwise(testing::FloatNear(1e-4F),
                                                    data["extras"][i].get<std::vector<float>>()));
    PoolAlongLine({pooled.data(), width, height, channels, 4},
                  junctions[static_cast<std::size_t>(lines[i].start)],
                  junctions[static_cast<std::size_t>(lines[i].end)], samples, out.data());
    EXPECT_THAT(out, testing::Pointwise(testing::FloatNear(1e-3F),
                                        data["along"][i].get<std::vector<float>>()));
    const auto offsets = data["end_offsets"].get<std::vector<float>>();
    const std::size_t one = offsets.size() * static_cast<std::size_t>(channels);
    std::vector<float> about_ends(2 * one);
    const Keypoint& start = junctions[static_cast<std::size_t>(lines[i].start)];
    const Keypoint& end = junctions[static_cast<std::size_t>(lines[i].end)];
    PoolAtEnd({pooled.data(), width, height, channels, 4}, start, end, offsets, about_ends.data());
    PoolAtEnd({pooled.data(), width, height, channels, 4}, end, start, offsets,
              about_ends.data() + one);
    EXPECT_THAT(about_ends, testing::Pointwise(testing::FloatNear(1e-3F),
                                               data["about_ends"][i].get<std::vector<float>>()));
  }
  std::vector<float> discounted =
      DiscountOverlaps(junctions, lines, data["scores"].get<std::vector<float>>(),
                       LineDecoderOptions().overlap_radius);
  std::sort(discounted.rbegin(), discounted.rend());
  EXPECT_THAT(discounted, testing::Pointwise(testing::FloatNear(1e-4F),
                                             data["discounted"].get<std::vector<float>>()));
}

TEST(LineDecoderOptions, NamesTheWrongField) {
  const auto error_of = [](auto change) -> std::string {
    LineDecoderOptions options;
    change(options);
    try {
      options.Validate();
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  };
  using O = LineDecoderOptions;
  EXPECT_EQ(error_of([](O&) {}), "");
  EXPECT_THAT(error_of([](O& o) { o.stride = 0; }), testing::HasSubstr("stride is 0"));
  EXPECT_THAT(error_of([](O& o) { o.snap = NAN; }), testing::HasSubstr("snap"));
  EXPECT_THAT(error_of([](O& o) { o.min_confidence = 1; }), testing::HasSubstr("min_confidence"));
  EXPECT_THAT(error_of([](O& o) { o.min_support = 0; }), testing::HasSubstr("min_support"));
  EXPECT_THAT(error_of([](O& o) { o.max_masked = -1; }), testing::HasSubstr("max_masked"));
}

}  // namespace
}  // namespace airslam
