// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/feature/line_refinement.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <opencv2/imgproc.hpp>

namespace airslam {
namespace {

// An image whose grey levels rise by `contrast` from the upper side of a line to the lower one.
class LineRefinement : public ::testing::Test {
 protected:
  // The line that passes x = 0 at `y0` and falls by `slope` pixels a pixel; the edge's width is a
  // lens's.
  void ShowEdge(double y0, double slope, double contrast) {
    y0_ = y0;
    slope_ = slope;
    image_.create(200, 300, CV_8UC1);
    for (int v = 0; v < image_.rows; ++v) {
      for (int u = 0; u < image_.cols; ++u) {
        const double rise = 0.5 * (1 + std::erf(Below(u, v) / 1.2));
        image_.at<std::uint8_t>(v, u) = cv::saturate_cast<std::uint8_t>(60 + contrast * rise);
      }
    }
  }

  void AddNoise(double deviation) {
    cv::Mat noise(image_.size(), CV_16SC1), noisy;
    cv::RNG(7).fill(noise, cv::RNG::NORMAL, 0, deviation);
    cv::add(image_, noise, noisy, cv::noArray(), CV_16S);
    noisy.convertTo(image_, CV_8U);
  }

  // Signed distance in pixels from the edge.
  double Below(double x, double y) const {
    return (y - y0_ - slope_ * x) / std::hypot(1.0, slope_);
  }

  // A line beside the edge: by so many pixels across it at x = 50 and at x = 250.
  LineSegment Beside(double first, double last) const {
    const double stretch = std::hypot(1.0, slope_);
    return {50, static_cast<float>(y0_ + slope_ * 50 + first * stretch), 250,
            static_cast<float>(y0_ + slope_ * 250 + last * stretch), 0.6F};
  }

  cv::Mat image_;
  double y0_ = 0, slope_ = 0;
};

TEST_F(LineRefinement, EndsMoveOntoTheEdge) {
  for (double slope : {0.0, 0.17, -0.4}) {
    ShowEdge(101.3, slope, 80);
    for (double off : {-1.5, 0.0, 2.0}) {
      const auto edge = RefineLine(Beside(off, 0.4 * off), image_);
      ASSERT_TRUE(edge) << slope << " " << off;
      EXPECT_NEAR(Below(edge->x1, edge->y1), 0, 0.05) << slope << " " << off;
      EXPECT_NEAR(Below(edge->x2, edge->y2), 0, 0.05) << slope << " " << off;
      EXPECT_EQ(edge->score, 0.6F);
    }
  }
}

TEST_F(LineRefinement, EndsMoveAcrossTheLineOnly) {
  ShowEdge(101.3, 0.17, 80);
  const LineSegment line = Beside(1.2, 1.2);
  const auto edge = RefineLine(line, image_);
  ASSERT_TRUE(edge);
  const double along_x = line.x2 - line.x1, along_y = line.y2 - line.y1;
  EXPECT_NEAR((edge->x1 - line.x1) * along_x + (edge->y1 - line.y1) * along_y, 0, 0.02);
  EXPECT_NEAR((edge->x2 - line.x2) * along_x + (edge->y2 - line.y2) * along_y, 0, 0.02);
}

TEST_F(LineRefinement, TheDirectionOfTheLineAndOfTheLightDoNotMatter) {
  ShowEdge(101.3, -0.2, -50);
  const LineSegment line = Beside(-1, 1);
  const auto edge = RefineLine({line.x2, line.y2, line.x1, line.y1, 1}, image_);
  ASSERT_TRUE(edge);
  EXPECT_NEAR(Below(edge->x1, edge->y1), 0, 0.05);
  EXPECT_NEAR(Below(edge->x2, edge->y2), 0, 0.05);
}

TEST_F(LineRefinement, AWeakEdgeInNoiseIsFoundToATenthOfAPixel) {
  ShowEdge(101.3, 0.1, 30);
  AddNoise(3);
  const auto edge = RefineLine(Beside(1, -1), image_);
  ASSERT_TRUE(edge);
  EXPECT_NEAR(Below(edge->x1, edge->y1), 0, 0.2);
  EXPECT_NEAR(Below(edge->x2, edge->y2), 0, 0.2);
}

TEST_F(LineRefinement, AnEdgeThatIsHiddenForAThirdOfTheLineIsStillFound) {
  ShowEdge(101.3, 0.1, 80);
  image_.colRange(120, 180) = 200;
  const auto edge = RefineLine(Beside(1, -1), image_);
  ASSERT_TRUE(edge);
  EXPECT_NEAR(Below(edge->x1, edge->y1), 0, 0.05);
  EXPECT_NEAR(Below(edge->x2, edge->y2), 0, 0.05);
}

TEST_F(LineRefinement, OfTwoEdgesTheNearerIsTaken) {
  ShowEdge(101.3, 0, 60);
  image_.rowRange(106, 200) = 60;  // falls again there
  const auto upper = RefineLine({50, 101, 250, 101, 1}, image_);
  const auto lower = RefineLine({50, 106, 250, 106, 1}, image_);
  ASSERT_TRUE(upper && lower);
  EXPECT_NEAR(upper->y1, 101.3, 0.1);
  EXPECT_NEAR(lower->y1, 105.5, 0.1);
}

TEST_F(LineRefinement, WithoutAnEdgeThereIsNone) {
  ShowEdge(101.3, 0.1, 80);
  EXPECT_FALSE(RefineLine(Beside(8, 8), image_));           // too far away
  EXPECT_FALSE(RefineLine({50, 100, 55, 100, 1}, image_));  // too short
  image_ = cv::Mat(image_.size(), CV_8UC1, cv::Scalar(90));
  EXPECT_FALSE(RefineLine(Beside(0, 0), image_));
  AddNoise(6);
  EXPECT_FALSE(RefineLine(Beside(0, 0), image_));
}

TEST_F(LineRefinement, ALineAtTheImagesBorderIsLookedAtWithinIt) {
  ShowEdge(1.0, 0, 80);
  const auto edge = RefineLine({-20, 0, 320, 0, 1}, image_);
  ASSERT_TRUE(edge);
  EXPECT_NEAR(edge->y1, 1.0, 0.1);
}

}  // namespace
}  // namespace airslam
