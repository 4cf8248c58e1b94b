// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/place/match_verification.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <random>

#include "airslam/place/test_place.h"
#include "airslam/sensor/temporary_folder.h"

namespace airslam {
namespace {

const SyntheticPlace& Place() {
  static const SyntheticPlace place;
  return place;
}

PlaceMatch Verify(const Detections& query, KeyframeId keyframe) {
  SyntheticMatcher matcher;
  return VerifyPlace({query.keypoints, query.descriptors, Place().camera()}, Place().map(),
                     Place().map().keyframes.at(keyframe), matcher, {});
}

Detections Detect(int frame) { return SyntheticDetector().Detect(Place().Image(frame), {}, 300); }

TEST(MatchVerificationTest, FindsThePoseOfAFrameNearAKeyframe) {
  const Detections query = Detect(9);  // one frame after keyframe 2
  const PlaceMatch match = Verify(query, 2);
  EXPECT_EQ(match.keyframe, 2);
  ASSERT_GT(match.inliers.size(), 30U);
  EXPECT_GE(match.matches, static_cast<int>(match.inliers.size()));
  const Rigid3 error = match.world_from_cam.Inverse() * Place().WorldFromCam(9);
  EXPECT_LT(error.translation.norm(), 0.03);
  EXPECT_LT(error.Angle(), 0.01);
  EXPECT_GT(match.rms, 0);
  const Keyframe& keyframe = Place().map().keyframes.at(2);
  for (const PlaceInlier& inlier : match.inliers) {
    EXPECT_EQ(keyframe.landmarks[static_cast<std::size_t>(inlier.keyframe_keypoint)],
              inlier.landmark);
    const Keypoint& k = query.keypoints[static_cast<std::size_t>(inlier.keypoint)];
    const Eigen::Vector2d projected =
        Place().camera().Project(match.world_from_cam.Inverse() *
                                 Place().map().landmarks.at(inlier.landmark).point_in_world);
    EXPECT_LT((projected - Eigen::Vector2d(k.x, k.y)).norm(), 4);
  }
}

// Matches keypoint i with keypoint i.
class SameIndexMatcher : public FeatureMatcher {
 public:
  std::vector<airslam::Match> Match(const MatcherInput& image0, const MatcherInput&) override {
    std::vector<airslam::Match> matches;
    for (int i = 0; i < static_cast<int>(image0.keypoints.size()); ++i)
      matches.push_back({i, i, 1});
    return matches;
  }
};

// The squared error of a pose in units of its covariance, for keypoints with a noise of `sigma`.
double NormalizedError(double sigma, std::mt19937& random) {
  std::normal_distribution<double> noise(0, sigma);
  const Keyframe& keyframe = Place().map().keyframes.at(2);
  const Rigid3 truth = Place().WorldFromCam(9);
  std::vector<Keypoint> keypoints;
  for (const LandmarkId id : keyframe.landmarks) {
    const Eigen::Vector3d& point = Place().map().landmarks.at(id).point_in_world;
    const Eigen::Vector2d pixel = Place().camera().Project(truth.Inverse() * point);
    keypoints.push_back({static_cast<float>(pixel.x() + noise(random)),
                         static_cast<float>(pixel.y() + noise(random)), 1});
  }
  SameIndexMatcher matcher;
  const PlaceMatch match = VerifyPlace({keypoints, keyframe.descriptors, Place().camera()},
                                       Place().map(), keyframe, matcher, {});
  const Eigen::Quaterniond turn = match.world_from_cam.rotation.conjugate() * truth.rotation;
  Eigen::Matrix<double, 6, 1> error;
  error << (turn.w() < 0 ? -2 : 2) * turn.vec(),
      truth.translation - match.world_from_cam.translation;
  return error.dot(match.covariance.ldlt().solve(error));
}

TEST(MatchVerificationTest, TheCovarianceIsThatOfTheErrors) {
  std::mt19937 random(1);
  constexpr int kTrials = 60;
  double expected = 0, noisy = 0, exact = 0;
  for (int i = 0; i < kTrials; ++i) {
    expected += NormalizedError(1.0, random) / kTrials;
    noisy += NormalizedError(1.2, random) / kTrials;
    exact += NormalizedError(0.1, random) / kTrials;
  }
  // The mean of chi-squared with six degrees of freedom, four standard deviations of it about.
  EXPECT_NEAR(expected, 6, 1.8);
  // More noise than pixel_sigma shows in the residuals; less is not believed.
  EXPECT_NEAR(noisy, 6, 2.5);
  EXPECT_LT(exact, 1);
}

TEST(MatchVerificationTest, AnotherPlaceHasFewInliers) {
  // The last keyframe looks elsewhere.
  EXPECT_LT(Verify(Detect(1), 9).inliers.size(), 12U);
  EXPECT_TRUE(Verify({}, 0).inliers.empty());
}

TEST(MatchVerificationTest, KeypointsWithoutALandmarkDoNotCount) {
  SyntheticPlace place(5, 4);
  Keyframe& keyframe = place.map().keyframes.at(0);
  std::fill(keyframe.landmarks.begin() + 8, keyframe.landmarks.end(), kNoLandmark);
  const Detections query = SyntheticDetector().Detect(place.Image(0), {}, 300);
  SyntheticMatcher matcher;
  const PlaceMatch match = VerifyPlace({query.keypoints, query.descriptors, place.camera()},
                                       place.map(), keyframe, matcher, {});
  EXPECT_LE(match.matches, 8);
  EXPECT_GE(match.matches, 6);
}

TEST(MatchVerificationTest, OptionsAreChecked) {
  VerificationOptions options;
  options.pixel_sigma = 0;
  EXPECT_THAT(ErrorOf([&] { options.Validate(); }), testing::HasSubstr("pixel_sigma"));
  options = {};
  options.ransac.max_error = -1;
  EXPECT_THAT(ErrorOf([&] { options.Validate(); }), testing::HasSubstr("max_error"));
}

}  // namespace
}  // namespace airslam
