// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/geometry/alignment.h"

#include <Eigen/SVD>

#include "airslam/common/error.h"

namespace airslam {
namespace {

// The second singular value of the covariance below which, relative to the first, the points count
// as lying on one line.
constexpr double kCollinear = 1e-12;

Eigen::Vector3d Mean(std::span<const Eigen::Vector3d> points) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& point : points) sum += point;
  return sum / static_cast<double>(points.size());
}

}  // namespace

std::optional<Similarity3> AlignPoints(std::span<const Eigen::Vector3d> points_in_a,
                                       std::span<const Eigen::Vector3d> points_in_b,
                                       bool with_scale) {
  if (points_in_a.size() != points_in_b.size()) {
    Fail("alignment needs pairs of points, but got {} and {} points", points_in_a.size(),
         points_in_b.size());
  }
  if (points_in_a.size() < 3) return std::nullopt;

  const Eigen::Vector3d mean_a = Mean(points_in_a);
  const Eigen::Vector3d mean_b = Mean(points_in_b);
  const double count = static_cast<double>(points_in_a.size());
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  double variance_a = 0;
  for (std::size_t i = 0; i < points_in_a.size(); ++i) {
    covariance += (points_in_b[i] - mean_b) * (points_in_a[i] - mean_a).transpose() / count;
    variance_a += (points_in_a[i] - mean_a).squaredNorm() / count;
  }

  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(covariance,
                                              Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Eigen::Vector3d singular = svd.singularValues();
  if (!(singular(1) > kCollinear * singular(0))) return std::nullopt;

  // A reflection is not a rotation: turn the axis that costs least.
  Eigen::Vector3d sign = Eigen::Vector3d::Ones();
  if (svd.matrixU().determinant() * svd.matrixV().determinant() < 0) sign.z() = -1;

  Similarity3 b_from_a;
  const Eigen::Matrix3d rotation = svd.matrixU() * sign.asDiagonal() * svd.matrixV().transpose();
  b_from_a.rotation = Eigen::Quaterniond(rotation).normalized();
  if (with_scale) b_from_a.scale = singular.dot(sign) / variance_a;
  b_from_a.translation = mean_b - b_from_a.scale * (b_from_a.rotation * mean_a);
  return b_from_a;
}

}  // namespace airslam
