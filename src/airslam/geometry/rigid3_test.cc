// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/geometry/rigid3.h"

#include <gtest/gtest.h>

#include "airslam/geometry/so3.h"

namespace airslam {
namespace {

const Rigid3 kBFromA(ExpSO3({0.3, -1.2, 0.8}), {1, -2, 3});
const Rigid3 kCFromB(ExpSO3({-0.5, 0.1, 2.0}), {0.2, 4, -1});
const Eigen::Vector3d kPointInA(0.7, 5, -2);

TEST(Rigid3, ComposesFromRightToLeft) {
  EXPECT_LT((kCFromB * kBFromA * kPointInA - kCFromB * (kBFromA * kPointInA)).norm(), 1e-12);
}

TEST(Rigid3, InverseUndoesIt) {
  EXPECT_LT((kBFromA.Inverse() * (kBFromA * kPointInA) - kPointInA).norm(), 1e-12);
}

TEST(Rigid3, MatrixActsLikeTheTransform) {
  const Eigen::Vector3d by_matrix = (kBFromA.ToMatrix() * kPointInA.homogeneous()).head<3>();
  EXPECT_LT((by_matrix - kBFromA * kPointInA).norm(), 1e-12);
  const Rigid3 back = Rigid3::FromMatrix(kBFromA.ToMatrix());
  EXPECT_LT(back.rotation.angularDistance(kBFromA.rotation), 1e-7);
  EXPECT_EQ(back.translation, kBFromA.translation);
}

TEST(Rigid3, AngleIsTheShortOne) {
  EXPECT_NEAR(Rigid3(ExpSO3({0, 0.25, 0}), {9, 9, 9}).Angle(), 0.25, 1e-12);
  EXPECT_NEAR(Rigid3(ExpSO3({0, 5.0, 0}), {0, 0, 0}).Angle(), 2 * 3.14159265358979 - 5.0, 1e-12);
}

}  // namespace
}  // namespace airslam
