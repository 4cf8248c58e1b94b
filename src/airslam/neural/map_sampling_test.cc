// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/neural/map_sampling.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <vector>

namespace airslam {
namespace {

// 3x4 cells: channel 0 is the cell's column, channel 1 its row.
std::vector<float> PositionMap(MapLayout layout) {
  std::vector<float> map(24);
  for (std::size_t y = 0; y < 3; ++y) {
    for (std::size_t x = 0; x < 4; ++x) {
      const std::size_t cell = 4 * y + x;
      map[layout == MapLayout::kCells ? 2 * cell : cell] = static_cast<float>(x);
      map[layout == MapLayout::kCells ? 2 * cell + 1 : 12 + cell] = static_cast<float>(y);
    }
  }
  return map;
}

TEST(SampleAtKeypoints, FollowsTheCellConvention) {
  const std::vector<Keypoint> points = {{5.3F, 6.9F, 0}, {9.5F, 3.0F, 0}};
  for (const MapLayout layout : {MapLayout::kCells, MapLayout::kPlanes}) {
    const std::vector<float> map = PositionMap(layout);
    for (const bool half_pixel : {true, false}) {
      std::array<float, 6> rows = {-1, -1, -1, -1, -1, -1};
      SampleAtKeypoints({map.data(), 4, 3, 2, 4, layout}, points, half_pixel, rows.data(), 3);
      for (std::size_t i = 0; i < 2; ++i) {
        const Keypoint& k = points[i];
        EXPECT_NEAR(rows[3 * i], half_pixel ? (k.x + 0.5) / 4 - 0.5 : k.x / 4, 1e-5);
        EXPECT_NEAR(rows[3 * i + 1], half_pixel ? (k.y + 0.5) / 4 - 0.5 : k.y / 4, 1e-5);
      }
      EXPECT_EQ(rows[2], -1);  // between the rows nothing is written
    }
  }
}

TEST(SampleAtKeypoints, ClampsAtTheBorder) {
  const std::vector<Keypoint> points = {{-9, -9, 0}, {99, 99, 0}, {15, 0, 0}};
  for (const MapLayout layout : {MapLayout::kCells, MapLayout::kPlanes}) {
    const std::vector<float> map = PositionMap(layout);
    std::vector<float> rows(6);
    SampleAtKeypoints({map.data(), 4, 3, 2, 4, layout}, points, true, rows.data(), 2);
    EXPECT_THAT(rows, testing::ElementsAre(0, 0, 3, 2, 3, 0));
  }
}

TEST(PoolAlongLine, SamplesBetweenCells) {
  std::vector<float> map;  // 5x4 cells: channel 0 the column, channel 1 the row
  for (int row = 0; row < 4; ++row) {
    for (int column = 0; column < 5; ++column) {
      map.push_back(static_cast<float>(column));
      map.push_back(static_cast<float>(row));
    }
  }
  std::vector<float> out(6);
  PoolAlongLine({map.data(), 5, 4, 2, 4}, {3.5F, 2.5F, 0}, {11.5F, 8.5F, 0}, 3, out.data());
  EXPECT_THAT(
      out, testing::Pointwise(testing::FloatNear(1e-5F), {0.5F, 0.25F, 1.5F, 1.0F, 2.5F, 1.75F}));
  PoolAlongLine({map.data(), 5, 4, 2, 4}, {-20, -20, 0}, {100, 100, 0}, 2, out.data());
  EXPECT_EQ(out[0], 0);
  EXPECT_EQ(out[2], 4);
  EXPECT_EQ(out[3], 3);
}

TEST(UnfoldCells, PutsEachPixelInItsPlace) {
  for (const int stride : {2, 4, 8}) {  // 3x2 cells: the value is the pixel's row-major index
    const int width = 3 * stride;
    std::vector<float> cells, expected;
    for (int i = 0; i < 6 * stride * stride; ++i) {
      const int cell = i / (stride * stride), row = i / stride % stride, column = i % stride;
      cells.push_back(
          static_cast<float>((cell / 3 * stride + row) * width + cell % 3 * stride + column));
      expected.push_back(static_cast<float>(i));
    }
    std::vector<float> plane(cells.size());
    UnfoldCells({cells.data(), 3, 2, stride * stride, stride}, plane.data());
    EXPECT_EQ(plane, expected) << stride;
  }
}

}  // namespace
}  // namespace airslam
