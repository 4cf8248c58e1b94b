// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/neural/transformer_matcher.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "airslam/common/error.h"

namespace airslam {
namespace {

// The test networks (testdata/make_test_models.py): stage 0 matches by the first three values of
// the descriptors and is as sure as the fourth says; stage 1 matches by position. N is 8, D is 4.
constexpr char kPack[] = AIRSLAM_SOURCE_DIR "/src/airslam/neural/testdata/pack";

NetworkLoader ExactLoader() {
  OpenVinoOptions options;
  options.precision = Precision::kF32;
  options.cache_folder.clear();
  return OpenVinoLoader(options);
}

MatcherSpec Spec() { return *ReadModelPack(kPack).matcher; }

struct Features {
  std::vector<Keypoint> keypoints;
  DescriptorMatrix descriptors;
  cv::Size size = {100, 50};

  MatcherInput input() const { return {keypoints, descriptors, size}; }
};

// Points with the given axis as descriptor (0, 1 or 2) and this confidence.
Features MakeFeatures(const std::vector<cv::Point2f>& points, const std::vector<int>& axes,
                      float confidence) {
  Features f;
  f.descriptors = DescriptorMatrix::Zero(static_cast<Eigen::Index>(points.size()), 4);
  for (std::size_t i = 0; i < points.size(); ++i) {
    f.keypoints.push_back({points[i].x, points[i].y, 10.0F - static_cast<float>(i)});
    f.descriptors(static_cast<Eigen::Index>(i), axes[i]) = 1;
    f.descriptors(static_cast<Eigen::Index>(i), 3) = confidence;
  }
  return f;
}

std::vector<std::pair<int, int>> Pairs(const std::vector<Match>& matches) {
  std::vector<std::pair<int, int>> pairs;
  for (const Match& m : matches) pairs.emplace_back(m.index0, m.index1);
  return pairs;
}

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Pair;

const std::vector<cv::Point2f> kThreePoints = {{10, 10}, {50, 40}, {90, 10}};

TEST(TransformerMatcher, StopsAfterTheFirstStageWhenSure) {
  TransformerMatcher matcher(Spec(), 4, ExactLoader());
  const Features f0 = MakeFeatures(kThreePoints, {0, 1, 2}, 1);
  const Features f1 = MakeFeatures(kThreePoints, {2, 0, 1}, 1);
  const std::vector<Match> matches = matcher.Match(f0.input(), f1.input());
  EXPECT_THAT(Pairs(matches), ElementsAre(Pair(0, 1), Pair(1, 2), Pair(2, 0)));
  for (const Match& m : matches) EXPECT_NEAR(m.score, 1 / (1 + std::exp(-10.0)), 1e-4);
  EXPECT_THAT(matcher.statistics().calls_ended_after, ElementsAre(1, 0));
  EXPECT_EQ(matcher.statistics().MeanStages(), 1);
}

TEST(TransformerMatcher, GoesOnWhenUnsure) {
  TransformerMatcher matcher(Spec(), 4, ExactLoader());
  const Features f0 = MakeFeatures(kThreePoints, {0, 1, 2}, 0.5F);
  const Features f1 = MakeFeatures(kThreePoints, {2, 0, 1}, 0.5F);
  EXPECT_THAT(Pairs(matcher.Match(f0.input(), f1.input())),
              ElementsAre(Pair(0, 0), Pair(1, 1), Pair(2, 2)));
  EXPECT_THAT(matcher.statistics().calls_ended_after, ElementsAre(0, 1));
  EXPECT_EQ(matcher.statistics().MeanStages(), 2);
}

TEST(TransformerMatcher, OneUnsurePointInSixIsTooMany) {
  TransformerMatcher matcher(Spec(), 4, ExactLoader());
  const Features f0 = MakeFeatures(kThreePoints, {0, 1, 2}, 1);
  Features f1 = MakeFeatures(kThreePoints, {2, 0, 1}, 1);
  f1.descriptors(1, 3) = 0.85F;  // the pack asks for more than 0.9
  matcher.Match(f0.input(), f1.input());
  EXPECT_THAT(matcher.statistics().calls_ended_after, ElementsAre(0, 1));
}

TEST(TransformerMatcher, NormalisesPositionsByTheLongerSide) {
  TransformerMatcher matcher(Spec(), 4, ExactLoader());
  // Stage 1 says 1 - |k0 - k1|^2, k = (pixel - size / 2) / (max(size) / 2).
  Features f0 = MakeFeatures({{60, 30}}, {0}, 0);
  Features f1 = MakeFeatures({{130, 110}}, {0}, 0);
  f1.size = {200, 200};
  const std::vector<Match> matches = matcher.Match(f0.input(), f1.input());
  ASSERT_EQ(matches.size(), 1U);
  const double dx = 10.0 / 50 - 30.0 / 100, dy = 5.0 / 50 - 10.0 / 100;
  EXPECT_NEAR(matches[0].score, 1 - dx * dx - dy * dy, 1e-5);
}

TEST(TransformerMatcher, PaddingNeverMatches) {
  MatcherSpec spec = Spec();
  spec.threshold = 0;
  TransformerMatcher matcher(spec, 4, ExactLoader());
  // Padded points lie at the centre: so does this one, and there is only one on the other side.
  const Features f0 = MakeFeatures({{50, 25}, {51, 25}, {10, 10}}, {0, 1, 2}, 0);
  const Features f1 = MakeFeatures({{50, 25}}, {0}, 0);
  EXPECT_THAT(Pairs(matcher.Match(f0.input(), f1.input())), ElementsAre(Pair(0, 0)));
  // And what an earlier call left behind is gone.
  EXPECT_THAT(Pairs(matcher.Match(f1.input(), f1.input())), ElementsAre(Pair(0, 0)));
}

TEST(TransformerMatcher, AppliesTheThreshold) {
  MatcherSpec spec = Spec();
  const Features f0 = MakeFeatures({{0, 0}, {100, 50}}, {0, 1}, 0);
  const Features f1 = MakeFeatures({{40, 0}, {100, 50}}, {0, 1}, 0);  // 0: 1 - 0.8^2 = 0.36
  spec.threshold = 0.3F;
  EXPECT_THAT(Pairs(TransformerMatcher(spec, 4, ExactLoader()).Match(f0.input(), f1.input())),
              ElementsAre(Pair(0, 0), Pair(1, 1)));
  spec.threshold = 0.4F;
  EXPECT_THAT(Pairs(TransformerMatcher(spec, 4, ExactLoader()).Match(f0.input(), f1.input())),
              ElementsAre(Pair(1, 1)));
}

TEST(TransformerMatcher, TakesTheBestWhenThereAreTooMany) {
  TransformerMatcher matcher(Spec(), 4, ExactLoader());
  std::vector<cv::Point2f> points;
  for (int i = 0; i < 12; ++i) points.emplace_back(static_cast<float>(5 + 8 * i), 20.0F);
  Features f = MakeFeatures(points, std::vector<int>(12, 0), 0);
  for (std::size_t i = 0; i < 4; ++i) f.keypoints[i].score = -5;  // the four worst come first
  const std::vector<std::pair<int, int>> pairs = Pairs(matcher.Match(f.input(), f.input()));
  ASSERT_EQ(pairs.size(), 8U);
  for (int i = 0; i < 8; ++i)
    EXPECT_EQ(pairs[static_cast<std::size_t>(i)], std::pair(i + 4, i + 4));
}

TEST(TransformerMatcher, NothingMatchesNothing) {
  TransformerMatcher matcher(Spec(), 4, ExactLoader());
  const Features none = MakeFeatures({}, {}, 0);
  const Features three = MakeFeatures(kThreePoints, {0, 1, 2}, 0);
  EXPECT_THAT(matcher.Match(none.input(), three.input()), IsEmpty());
  EXPECT_THAT(matcher.Match(three.input(), none.input()), IsEmpty());
  EXPECT_THAT(matcher.statistics().calls_ended_after, ElementsAre(0, 0));
  EXPECT_EQ(matcher.statistics().MeanStages(), 0);
}

std::string ErrorOf(const MatcherSpec& spec, int descriptor_size) {
  try {
    TransformerMatcher matcher(spec, descriptor_size, ExactLoader());
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

TEST(TransformerMatcher, SaysWhatDoesNotFit) {
  EXPECT_THAT(ErrorOf(Spec(), 64),
              HasSubstr("input 'descriptors0' has the shape 1x8x4, expected 1x8x64"));
  MatcherSpec spec = Spec();
  spec.keypoints = 9;
  EXPECT_THAT(ErrorOf(spec, 4), HasSubstr("expected 1x9x4"));
  spec = Spec();
  std::swap(spec.stages[0], spec.stages[1]);
  EXPECT_THAT(ErrorOf(spec, 4), HasSubstr("has no input 'descriptors0'"));
  spec.stages.clear();
  EXPECT_THAT(ErrorOf(spec, 4), HasSubstr("at least one stage"));

  TransformerMatcher matcher(Spec(), 4, ExactLoader());
  Features wide = MakeFeatures(kThreePoints, {0, 1, 2}, 0);
  wide.descriptors = DescriptorMatrix::Ones(3, 5);
  EXPECT_THROW(matcher.Match(wide.input(), wide.input()), Error);
  Features few = MakeFeatures(kThreePoints, {0, 1, 2}, 0);
  few.keypoints.pop_back();
  EXPECT_THROW(matcher.Match(few.input(), few.input()), Error);
}

}  // namespace
}  // namespace airslam
