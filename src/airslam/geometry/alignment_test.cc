// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/geometry/alignment.h"

#include <gtest/gtest.h>

#include <random>
#include <vector>

#include "airslam/common/error.h"
#include "airslam/geometry/so3.h"

namespace airslam {
namespace {

using Points = std::vector<Eigen::Vector3d>;

Points RandomPoints(int count, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-5, 5);
  Points points;
  for (int i = 0; i < count; ++i) points.emplace_back(uniform(random), uniform(random), 3.0);
  for (int i = 0; i < count; ++i) points[i].z() += uniform(random);
  return points;
}

Similarity3 SomeSimilarity(double scale) {
  Similarity3 b_from_a;
  b_from_a.scale = scale;
  b_from_a.rotation = ExpSO3({0.4, -2.1, 0.9});
  b_from_a.translation = {3, -7, 0.5};
  return b_from_a;
}

Points Transformed(const Similarity3& b_from_a, const Points& points) {
  Points result;
  for (const Eigen::Vector3d& point : points) result.push_back(b_from_a * point);
  return result;
}

void ExpectNear(const Similarity3& expected, const Similarity3& actual, double tolerance) {
  EXPECT_NEAR(expected.scale, actual.scale, tolerance);
  EXPECT_LT(expected.rotation.angularDistance(actual.rotation), tolerance);
  EXPECT_LT((expected.translation - actual.translation).norm(), tolerance);
}

double SumOfSquares(const Similarity3& b_from_a, const Points& a, const Points& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += (b[i] - b_from_a * a[i]).squaredNorm();
  return sum;
}

TEST(AlignPoints, RecoversARigidTransform) {
  const Points a = RandomPoints(20, 1);
  const Similarity3 truth = SomeSimilarity(1);
  const auto found = AlignPoints(a, Transformed(truth, a), /*with_scale=*/false);
  ASSERT_TRUE(found);
  ExpectNear(truth, *found, 1e-10);
}

TEST(AlignPoints, RecoversASimilarity) {
  const Points a = RandomPoints(20, 2);
  const Similarity3 truth = SomeSimilarity(2.5);
  const auto found = AlignPoints(a, Transformed(truth, a), /*with_scale=*/true);
  ASSERT_TRUE(found);
  ExpectNear(truth, *found, 1e-10);
}

TEST(AlignPoints, LeavesTheScaleAloneUnlessAsked) {
  const Points a = RandomPoints(20, 3);
  const auto found = AlignPoints(a, Transformed(SomeSimilarity(2.5), a), /*with_scale=*/false);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->scale, 1.0);
}

TEST(AlignPoints, AlignsPointsOfOnePlaneWithoutReflection) {
  Points a = RandomPoints(20, 4);
  for (Eigen::Vector3d& point : a) point.z() = 0;
  const Similarity3 truth = SomeSimilarity(1);
  const auto found = AlignPoints(a, Transformed(truth, a), /*with_scale=*/false);
  ASSERT_TRUE(found);
  ExpectNear(truth, *found, 1e-9);
}

TEST(AlignPoints, AnswersAMirroredSetWithARotation) {
  const Points a = RandomPoints(20, 5);
  Points b = a;
  for (Eigen::Vector3d& point : b) point.x() = -point.x();
  const auto found = AlignPoints(a, b, /*with_scale=*/false);
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->rotation.toRotationMatrix().determinant(), 1.0, 1e-12);
}

TEST(AlignPoints, IsAMinimumUnderNoise) {
  const Points a = RandomPoints(50, 6);
  Points b = Transformed(SomeSimilarity(1.5), a);
  std::mt19937 random(7);
  std::normal_distribution<double> noise(0, 0.3);
  for (Eigen::Vector3d& point : b) point += Eigen::Vector3d(noise(random), noise(random), 0.1);
  const auto found = AlignPoints(a, b, /*with_scale=*/true);
  ASSERT_TRUE(found);
  const double best = SumOfSquares(*found, a, b);
  for (int axis = 0; axis < 3; ++axis) {
    for (const double step : {-1e-3, 1e-3}) {
      const Eigen::Vector3d delta = step * Eigen::Vector3d::Unit(axis);
      Similarity3 other = *found;
      other.rotation = ExpSO3(delta) * other.rotation;
      EXPECT_GT(SumOfSquares(other, a, b), best);
      other = *found;
      other.translation += delta;
      EXPECT_GT(SumOfSquares(other, a, b), best);
      other = *found;
      other.scale *= 1 + step;
      EXPECT_GT(SumOfSquares(other, a, b), best);
    }
  }
}

TEST(AlignPoints, RefusesWhatDoesNotDetermineATransform) {
  const Points two = RandomPoints(2, 8);
  EXPECT_FALSE(AlignPoints(two, two, false));
  const Points same(10, Eigen::Vector3d(1, 2, 3));
  EXPECT_FALSE(AlignPoints(same, same, false));
  Points line;
  for (int i = 0; i < 10; ++i) line.emplace_back(i, 2.0 * i, 0.0);
  EXPECT_FALSE(AlignPoints(line, line, false));
  EXPECT_THROW(AlignPoints(two, line, false), Error);
}

TEST(Similarity3, MovesAPoseLikeItsPoints) {
  const Similarity3 b_from_a = SomeSimilarity(2);
  const Rigid3 a_from_c(ExpSO3({0.1, 0.2, 0.3}), {1, 2, 3});
  const Rigid3 b_from_c = b_from_a.Apply(a_from_c);
  // The origin of c is one point, its axes are directions: these do not scale.
  EXPECT_LT((b_from_c.translation - b_from_a * a_from_c.translation).norm(), 1e-12);
  const Eigen::Vector3d axis = b_from_a.rotation * (a_from_c.rotation * Eigen::Vector3d::UnitX());
  EXPECT_LT((b_from_c.rotation * Eigen::Vector3d::UnitX() - axis).norm(), 1e-12);
}

}  // namespace
}  // namespace airslam
