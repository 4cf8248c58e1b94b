// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/neural/image_maps.h"

#include <gtest/gtest.h>

#include <array>
#include <optional>

namespace airslam {
namespace {

constexpr std::array<int, 2> kSizes = {12, 5};

TEST(ImageMapPool, UsesMemoryAgainOnceNobodyHoldsIt) {
  ImageMapPool pool;
  auto first = pool.Take({4, 3}, kSizes);
  ASSERT_EQ(first->values.size(), 2U);
  EXPECT_EQ(first->values[0].total(), 12U);
  EXPECT_EQ(first->values[1].total(), 5U);
  const auto second = pool.Take({4, 3}, kSizes);
  const float* memory = first->values[0].ptr<float>();
  EXPECT_NE(second->values[0].ptr<float>(), memory);
  first.reset();
  EXPECT_EQ(pool.Take({4, 3}, kSizes)->values[0].ptr<float>(), memory);
}

TEST(ImageMapPool, FitsAnotherSize) {
  ImageMapPool pool;
  pool.Take({4, 3}, kSizes);
  const auto larger = pool.Take({8, 6}, std::array<int, 1>{48});
  ASSERT_EQ(larger->values.size(), 1U);
  EXPECT_EQ(larger->values[0].total(), 48U);
  EXPECT_EQ(larger->image_size, cv::Size(8, 6));
}

TEST(ImageMapPool, MapsOutliveIt) {
  std::optional<ImageMapPool> pool(std::in_place);
  auto maps = pool->Take({4, 3}, kSizes);
  pool.reset();
  maps->values[0] = 1.0F;
  EXPECT_EQ(maps->values[0].at<float>(0, 11), 1.0F);
  maps.reset();
}

}  // namespace
}  // namespace airslam
