// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/neural/line_support.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

namespace airslam {
namespace {

constexpr int kWidth = 40, kHeight = 30, kCells = kWidth * kHeight;

// A field in which cells see lines anywhere around them, some at random and some of a few common
// lines, so that pairs of junctions are supported to any share.
std::vector<float> RandomField(std::mt19937& random) {
  std::uniform_real_distribution<float> uniform(0, 1);
  std::vector<std::array<float, 4>> lines;  // a point and a normal
  for (int i = 0; i < 6; ++i) {
    const float angle = 6.2832F * uniform(random);
    lines.push_back(
        {160 * uniform(random), 120 * uniform(random), std::cos(angle), std::sin(angle)});
  }
  std::vector<float> field(6 * kCells);
  for (int i = 0; i < kCells; ++i) {
    field[i] = 4 * uniform(random) - 2.5F;
    const float x = static_cast<float>(4 * (i % kWidth)) + 1.5F;
    const float y = static_cast<float>(4 * (i / kWidth)) + 1.5F;
    float d = 16 * uniform(random), cosine = std::cos(6.2832F * uniform(random));
    float sine = std::sqrt(1 - cosine * cosine) * (uniform(random) < 0.5F ? -1.0F : 1.0F);
    for (const auto& [px, py, nx, ny] : lines) {
      const float distance = (px - x) * nx + (py - y) * ny;
      if (std::abs(distance) > 14 || uniform(random) < 0.15F) continue;
      d = std::max(std::abs(distance), 0.01F);
      cosine = distance < 0 ? -nx : nx;
      sine = distance < 0 ? -ny : ny;
    }
    field[kCells + i] = std::log(d / (16 - d));
    field[2 * kCells + i] = 3 * cosine;
    field[3 * kCells + i] = 3 * sine;
  }
  return field;
}

std::vector<Keypoint> RandomJunctions(int count, std::mt19937& random) {
  std::uniform_real_distribution<float> x(0, 4 * kWidth - 1), y(0, 4 * kHeight - 1);
  std::vector<Keypoint> junctions;
  for (int i = 0; i < count; ++i) junctions.push_back({x(random), y(random), 0.5F});
  for (int i = 0; i < count / 4; ++i) {  // at the border, level, upright and twice the same
    junctions.push_back({i % 2 == 0 ? 0.0F : 4 * kWidth - 1.0F, y(random), 0.5F});
    junctions.push_back({junctions[static_cast<std::size_t>(i)].x, y(random), 0.5F});
  }
  junctions.push_back(junctions.front());
  return junctions;
}

// What LineSupport's comment says, one sample after the other.
float SupportBySamples(const std::vector<float>& field, const Keypoint& p, const Keypoint& q) {
  const double length = std::hypot(q.x - p.x, q.y - p.y);
  if (length == 0) return 0;
  const double nx = (p.y - q.y) / length, ny = (q.x - p.x) / length;
  int agree = 0;
  for (int i = 0; i < 16; ++i) {
    const double t = (i + 0.5) / 16;
    bool agrees = false;
    for (const double side : {-5, 5}) {
      const double x = p.x + t * (q.x - p.x) + side * nx, y = p.y + t * (q.y - p.y) + side * ny;
      const int column = std::clamp(static_cast<int>(std::floor((x - 1.5) / 4 + 0.5)), 0, 39);
      const int row = std::clamp(static_cast<int>(std::floor((y - 1.5) / 4 + 0.5)), 0, 29);
      const int cell = row * kWidth + column;
      const auto plane = [&](int k) { return static_cast<double>(field[k * kCells + cell]); };
      if (!(1 / (1 + std::exp(-plane(0))) > 0.2)) continue;
      const double d = 16 / (1 + std::exp(-plane(1))), norm = std::hypot(plane(2), plane(3));
      const double cosine = plane(2) / norm, sine = plane(3) / norm;
      const double foot =
          (4 * column + 1.5 + d * cosine - p.x) * nx + (4 * row + 1.5 + d * sine - p.y) * ny;
      agrees |= std::abs(foot) < 4 && std::abs(cosine * nx + sine * ny) > 0.85;
    }
    agree += agrees ? 1 : 0;
  }
  return static_cast<float>(agree) / 16;
}

TEST(SeenLines, SupportIsTheShareOfSamples) {
  std::mt19937 random(3);
  const std::vector<float> field = RandomField(random);
  const SeenLines seen({field.data(), nullptr, kWidth, kHeight}, {});
  const std::vector<Keypoint> junctions = RandomJunctions(60, random);
  int compared = 0, different = 0, supported = 0;
  for (const Keypoint& p : junctions) {
    for (const Keypoint& q : junctions) {
      const float support = seen.Support(p, q);
      const float expected = SupportBySamples(field, p, q);
      ASSERT_LE(std::abs(support - expected), 1.0F / 16);  // where rounding decides
      different += support != expected;
      supported += support >= 0.5F;
      ++compared;
    }
  }
  EXPECT_LT(different, compared / 1000 + 1);
  EXPECT_GT(supported, compared / 50);
}

TEST(SeenLines, FindsAllThatIsPossible) {
  std::mt19937 random(8);
  int pairs = 0, possible_pairs = 0, supported = 0;
  for (int round = 0; round < 10; ++round) {
    const std::vector<float> field = RandomField(random);
    const SeenLines seen({field.data(), nullptr, kWidth, kHeight}, {});
    const std::vector<Keypoint> junctions = RandomJunctions(60, random);
    std::vector<std::uint8_t> possible(junctions.size());
    for (const float least : {0.4F, 0.75F}) {
      for (const Keypoint& p : junctions) {
        seen.FindPossible(p, junctions, least, possible);
        for (std::size_t j = 0; j < junctions.size(); ++j) {
          const bool is_supported = seen.Support(p, junctions[j]) >= least;
          ASSERT_TRUE(!is_supported || possible[j] == 1) << "round " << round << ", " << j;
          ++pairs;
          possible_pairs += possible[j];
          supported += is_supported;
        }
      }
    }
  }
  EXPECT_GT(supported, pairs / 50);
  EXPECT_LT(possible_pairs, pairs / 2);  // it is worth asking
}

TEST(SeenLines, NotANumberSupportsNothing) {
  std::vector<float> field(6 * kCells, std::numeric_limits<float>::quiet_NaN());
  std::fill_n(field.begin(), kCells, 3.0F);  // confident
  const SeenLines seen({field.data(), nullptr, kWidth, kHeight}, {});
  const std::vector<Keypoint> junctions = {
      {10, 10, 1}, {100, 80, 1}, {std::numeric_limits<float>::quiet_NaN(), 3, 1}};
  std::vector<std::uint8_t> possible(3, 9);
  seen.FindPossible(junctions[0], junctions, 0.75F, possible);
  EXPECT_EQ(possible, (std::vector<std::uint8_t>{0, 0, 0}));
  EXPECT_EQ(seen.Support(junctions[0], junctions[1]), 0);
  EXPECT_EQ(seen.Support(junctions[0], junctions[2]), 0);
}

}  // namespace
}  // namespace airslam
