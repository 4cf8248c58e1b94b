// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/neural/nearest_matcher.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numbers>

#include "airslam/common/error.h"

namespace airslam {
namespace {

// Unit vectors of the plane at these angles in degrees.
DescriptorMatrix AtAngles(const std::vector<float>& degrees) {
  DescriptorMatrix d(static_cast<Eigen::Index>(degrees.size()), 2);
  for (std::size_t i = 0; i < degrees.size(); ++i) {
    const float angle = degrees[i] * std::numbers::pi_v<float> / 180;
    d.row(static_cast<Eigen::Index>(i)) << std::cos(angle), std::sin(angle);
  }
  return d;
}

// Pairs of matched indices.
std::vector<std::pair<int, int>> Pairs(const DescriptorMatrix& d0, const DescriptorMatrix& d1,
                                       const NearestMatcherOptions& options = {}) {
  const std::vector<Keypoint> k0(static_cast<std::size_t>(d0.rows()));
  const std::vector<Keypoint> k1(static_cast<std::size_t>(d1.rows()));
  std::vector<std::pair<int, int>> pairs;
  for (const Match& m : NearestMatcher(options).Match({k0, d0, {64, 48}}, {k1, d1, {64, 48}})) {
    pairs.emplace_back(m.index0, m.index1);
    EXPECT_NEAR(m.score, d0.row(m.index0).dot(d1.row(m.index1)), 1e-6);
  }
  return pairs;
}

using testing::ElementsAre;
using testing::IsEmpty;
using testing::Pair;

TEST(NearestMatcher, MatchesMutualNeighboursOnly) {
  // 0 and 1 both lie next to 12; 10 is nearer, so 0 stays alone.
  EXPECT_THAT(Pairs(AtAngles({0, 10, 90}), AtAngles({95, 12})),
              ElementsAre(Pair(1, 1), Pair(2, 0)));
}

TEST(NearestMatcher, DropsUnlikeDescriptors) {
  NearestMatcherOptions options;
  options.min_cosine = 0.9F;  // 25.8 degrees
  EXPECT_THAT(Pairs(AtAngles({0, 90}), AtAngles({20, 120}), options), ElementsAre(Pair(0, 0)));
  options.min_cosine = -1;
  EXPECT_THAT(Pairs(AtAngles({0}), AtAngles({180}), options), ElementsAre(Pair(0, 0)));
}

TEST(NearestMatcher, RatioDropsAmbiguousMatchesInBothDirections) {
  NearestMatcherOptions options;
  options.max_squared_ratio = 0.6F;
  // 0 is nearest to 10 but nearly as near to -11; 90 is unmistakable.
  EXPECT_THAT(Pairs(AtAngles({0, 90}), AtAngles({10, -11, 92}), options), ElementsAre(Pair(1, 2)));
  EXPECT_THAT(Pairs(AtAngles({10, -11, 92}), AtAngles({0, 90}), options), ElementsAre(Pair(2, 1)));
  EXPECT_THAT(Pairs(AtAngles({0}), AtAngles({50}), options), ElementsAre(Pair(0, 0)));
}

TEST(NearestMatcher, OfEqualNeighboursTheFirstCounts) {
  EXPECT_THAT(Pairs(AtAngles({30, 30, 30}), AtAngles({30, 30})), ElementsAre(Pair(0, 0)));
}

TEST(NearestMatcher, NothingMatchesNothing) {
  EXPECT_THAT(Pairs(AtAngles({}), AtAngles({1, 2})), IsEmpty());
  EXPECT_THAT(Pairs(AtAngles({1, 2}), AtAngles({})), IsEmpty());
}

TEST(NearestMatcher, RefusesInconsistentInput) {
  const DescriptorMatrix two = AtAngles({0, 1});
  const DescriptorMatrix three_values = DescriptorMatrix::Ones(2, 3);
  const std::vector<Keypoint> one_keypoint(1), two_keypoints(2);
  NearestMatcher matcher;
  EXPECT_THROW(matcher.Match({one_keypoint, two, {}}, {two_keypoints, two, {}}), Error);
  EXPECT_THROW(matcher.Match({two_keypoints, two, {}}, {two_keypoints, three_values, {}}), Error);
  NearestMatcherOptions options;
  options.min_cosine = 2;
  EXPECT_THROW(NearestMatcher{options}, Error);
  options = {};
  options.max_squared_ratio = -1;
  EXPECT_THROW(NearestMatcher{options}, Error);
}

}  // namespace
}  // namespace airslam
