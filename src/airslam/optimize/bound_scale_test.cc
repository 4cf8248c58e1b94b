// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/bound_scale.h"

#include <gtest/gtest.h>

#include <random>

namespace airslam {
namespace {

// Mean squares of `rows` normal coordinates each.
std::vector<double> MeanSquares(int count, int rows, double deviation) {
  std::mt19937 random(3);
  std::normal_distribution<double> coordinate(0, deviation);
  std::vector<double> means(count, 0);
  for (double& mean : means) {
    for (int k = 0; k < rows; ++k) {
      const double c = coordinate(random);
      mean += c * c / rows;
    }
  }
  return means;
}

TEST(BoundScale, IsHalfAsMuchAgainAsTheDeviation) {
  for (int rows : {2, 3, 4}) {
    EXPECT_NEAR(BoundScale(MeanSquares(20000, rows, 0.2), 1, 0.01), 0.3, 0.02) << rows;
  }
}

TEST(BoundScale, UnknownsThatWereFittedCount) {
  EXPECT_NEAR(BoundScale(MeanSquares(20000, 3, 0.1), 4, 0.01), 0.3, 0.015);
}

TEST(BoundScale, AFewOutliersHardlyRaiseIt) {
  std::vector<double> means = MeanSquares(1000, 2, 0.2);
  means.insert(means.end(), 250, 1e6);
  EXPECT_NEAR(BoundScale(means, 1, 0.01), 0.3, 0.08);
}

TEST(BoundScale, StaysWithinItsLimits) {
  EXPECT_EQ(BoundScale(MeanSquares(100, 2, 0.01), 1, 0.25), 0.25);
  EXPECT_EQ(BoundScale(MeanSquares(100, 2, 5), 1, 0.25), 1);
  EXPECT_EQ(BoundScale(MeanSquares(100, 2, 0.01), 1, 1), 1);
  EXPECT_EQ(BoundScale({}, 1, 0.25), 1);
}

}  // namespace
}  // namespace airslam
