// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/calibrate/imu_check.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>

#include <fmt/format.h>

#include "airslam/calibrate/rig_fit.h"
#include "airslam/geometry/so3.h"
#include "airslam/sensor/imu_buffer.h"
#include "airslam/sensor/imu_preintegration.h"

namespace airslam {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kDegrees = 180 / std::numbers::pi;
constexpr std::size_t kMinPoints = 30;
constexpr std::size_t kMinTurns = 8;
constexpr double kMinTurn = 1 / kDegrees;       // rad, root mean square
constexpr double kLeastScale = 2e-4;            // rad: what two-view geometry reaches at best
constexpr double kSearch = 0.5, kStep = 0.005;  // s
constexpr double kMinSpread = 0.15;  // turning about the second axis, as a share of the first's

// The same camera at two times as a rig: left is the first.
StereoRig TwoTimes(const DistortedCamera& camera, const Matrix3d& from_cam_from_to,
                   const Vector3d& direction) {
  StereoRig rig;
  rig.left.camera = rig.right.camera = camera;
  rig.right.body_from_cam = Rigid3(Eigen::Quaterniond(from_cam_from_to), direction);
  return rig;
}

// The rotation that best turns the rays of the second image into those of the first.
Matrix3d Kabsch(const Matrix3d& correlation) {
  const Eigen::JacobiSVD<Matrix3d> svd(correlation, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Vector3d signs(1, 1, 1);
  signs.z() = (svd.matrixU() * svd.matrixV().transpose()).determinant() > 0 ? 1 : -1;
  return svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose();
}

Matrix3d PureRotation(const std::vector<RayMatch>& rays) {
  Matrix3d rotation = Matrix3d::Identity();
  for (int round = 0; round < 5; ++round) {
    Matrix3d correlation = Matrix3d::Zero();
    std::vector<double> errors;
    for (const RayMatch& ray : rays) {
      errors.push_back((ray.left.normalized() - rotation * ray.right.normalized()).norm());
    }
    const double scale = std::max(1e-4, AbsoluteQuantile(errors, 0.5));
    for (std::size_t i = 0; i < rays.size(); ++i) {
      const double weight = 1 / (1 + std::pow(errors[i] / scale, 2));
      correlation += weight * rays[i].left.normalized() * rays[i].right.normalized().transpose();
    }
    rotation = Kabsch(correlation);
  }
  return rotation;
}

std::vector<StereoRig> Starts(const DistortedCamera& camera, const std::vector<RayMatch>& rays) {
  std::vector<StereoRig> starts;
  const Matrix3d pure = PureRotation(rays);
  for (int axis = 0; axis < 3; ++axis) {
    starts.push_back(TwoTimes(camera, pure, Vector3d::Unit(axis)));
  }
  std::vector<cv::Point2d> from, to;
  for (const RayMatch& ray : rays) {
    from.emplace_back(ray.left.x(), ray.left.y());
    to.emplace_back(ray.right.x(), ray.right.y());
  }
  const double threshold = 1.0 / camera.pinhole.fx;
  const cv::Mat essential =
      cv::findEssentialMat(from, to, cv::Mat::eye(3, 3, CV_64F), cv::RANSAC, 0.999, threshold);
  if (essential.rows != 3 || essential.cols != 3) return starts;
  cv::Mat rotation, translation;
  cv::recoverPose(essential, from, to, cv::Mat::eye(3, 3, CV_64F), rotation, translation);
  Matrix3d to_from_from;
  Vector3d t;
  cv::cv2eigen(rotation, to_from_from);
  cv::cv2eigen(translation, t);
  starts.push_back(
      TwoTimes(camera, to_from_from.transpose(), -to_from_from.transpose() * t.normalized()));
  return starts;
}

// The gyroscope's turns over the times of the images, in the body.
std::vector<Vector3d> GyroscopeTurns(const ImuBuffer& imu, const std::vector<VisualTurn>& turns) {
  std::vector<Vector3d> vectors;
  for (const VisualTurn& turn : turns) {
    const ImuInterval interval = imu.Between(turn.from_ns, turn.to_ns);
    vectors.push_back(LogSO3(GyroscopeTurn(interval.samples, Vector3d::Zero())));
  }
  return vectors;
}

double Span(const VisualTurn& turn) {
  return 1e-9 * static_cast<double>(turn.to_ns - turn.from_ns);
}

// What remains of the differences at one time offset.
struct Agreement {
  Matrix3d cam_from_body;
  Vector3d bias = Vector3d::Zero();
  std::vector<Vector3d> expected;  // the gyroscope's turns in the camera, without bias
  std::vector<Vector3d> residuals;
  double scale = 0;
  double cost = 0;  // mean of the robust squares, rad^2
};

// Cauchy weights, a fixed number of rounds.
Agreement Agree(const std::vector<VisualTurn>& turns, const std::vector<Vector3d>& gyroscope,
                const Matrix3d& calibrated, bool free_rotation) {
  Agreement result;
  result.cam_from_body = calibrated;
  std::vector<double> weights(turns.size(), 1);
  for (int round = 0; round < 8; ++round) {
    Matrix3d correlation = Matrix3d::Zero();
    Vector3d bias = Vector3d::Zero();
    double seconds = 0;
    for (std::size_t i = 0; i < turns.size(); ++i) {
      const Vector3d in_body = gyroscope[i] - Span(turns[i]) * result.bias;
      correlation += weights[i] * turns[i].vector * in_body.transpose();
    }
    if (free_rotation) result.cam_from_body = Kabsch(correlation);
    for (std::size_t i = 0; i < turns.size(); ++i) {
      const double t = Span(turns[i]);
      const Vector3d difference = gyroscope[i] - result.cam_from_body.transpose() * turns[i].vector;
      bias += weights[i] * t * difference;
      seconds += weights[i] * t * t;
    }
    result.bias = bias / seconds;
    std::vector<double> lengths;
    result.residuals.clear();
    result.expected.clear();
    for (std::size_t i = 0; i < turns.size(); ++i) {
      const Vector3d in_body = gyroscope[i] - Span(turns[i]) * result.bias;
      result.expected.push_back(result.cam_from_body * in_body);
      result.residuals.push_back(turns[i].vector - result.expected.back());
      lengths.push_back(result.residuals.back().norm());
    }
    // The median length of a vector of three normal numbers is 1.538 sigma.
    result.scale = std::max(kLeastScale, AbsoluteQuantile(lengths, 0.5) / 1.538);
    result.cost = 0;
    for (std::size_t i = 0; i < turns.size(); ++i) {
      const double squared = std::pow(lengths[i] / (2 * result.scale), 2);
      weights[i] = 1 / (1 + squared);
      result.cost += std::log1p(squared) * 4 * result.scale * result.scale;
    }
  }
  return result;
}

class Checker {
 public:
  Checker(const StereoRig& rig, const std::vector<ImuSample>& imu,
          const std::vector<VisualTurn>& turns)
      : imu_(imu, {.time_offset = rig.imu_time_offset}),
        calibrated_(rig.left.body_from_cam.rotation.conjugate().toRotationMatrix()) {
    // Turns that the readings cover at every offset that is tried.
    for (const VisualTurn& turn : turns) {
      const auto margin = static_cast<std::int64_t>(kSearch * 1e9);
      if (imu_.Between(turn.from_ns - margin, turn.to_ns + margin).complete()) {
        turns_.push_back(turn);
      }
    }
  }

  ImuCheck Run() {
    ImuCheck check;
    check.turns = static_cast<int>(turns_.size());
    if (turns_.size() < kMinTurns) {
      check.unknown =
          fmt::format("only {} pairs of images tell how the camera turned, {} are needed",
                      turns_.size(), kMinTurns);
      return check;
    }
    double squares = 0;
    for (const VisualTurn& turn : turns_) squares += turn.vector.squaredNorm();
    check.mean_turn = std::sqrt(squares / static_cast<double>(turns_.size()));
    if (check.mean_turn < kMinTurn) {
      check.unknown = fmt::format(
          "the camera turns too little ({:.2f} degrees) to be compared "
          "with the gyroscope",
          kDegrees * check.mean_turn);
      return check;
    }
    free_rotation_ = TurnsAboutTwoAxes();
    Search(check);
    return check;
  }

 private:
  bool TurnsAboutTwoAxes() const {
    Matrix3d spread = Matrix3d::Zero();
    for (const VisualTurn& turn : turns_) spread += turn.vector * turn.vector.transpose();
    const Vector3d values = Eigen::SelfAdjointEigenSolver<Matrix3d>(spread).eigenvalues();
    return std::sqrt(std::max(0.0, values[1])) > kMinSpread * std::sqrt(values[2]);
  }
  Agreement At(double offset) const {
    const ImuBuffer moved = imu_.WithTimeOffset(imu_.options().time_offset + offset);
    return Agree(turns_, GyroscopeTurns(moved, turns_), calibrated_, free_rotation_);
  }
  void Search(ImuCheck& check) const;
  void ReadRotation(const Agreement& best, ImuCheck& check) const;

  ImuBuffer imu_;
  Matrix3d calibrated_;  // left_from_body
  std::vector<VisualTurn> turns_;
  bool free_rotation_ = false;
};

// The least cost on a grid, then the parabola through it and its neighbours.
void Checker::Search(ImuCheck& check) const {
  const int steps = static_cast<int>(std::lround(kSearch / kStep));
  std::vector<double> costs;
  for (int k = -steps; k <= steps; ++k) costs.push_back(At(k * kStep).cost);
  const auto least = std::min_element(costs.begin(), costs.end());
  const auto at = static_cast<int>(least - costs.begin());
  double offset = (at - steps) * kStep;
  if (at > 0 && at + 1 < static_cast<int>(costs.size())) {
    const double below = *(least - 1), above = *(least + 1);
    const double curvature = below - 2 * *least + above;
    if (curvature > 0) offset += kStep * 0.5 * (below - above) / curvature;
  }
  const Agreement best = At(offset);
  check.time_offset = offset;
  check.residual = best.scale;
  check.gyroscope_bias = best.bias;
  // How fast the residuals change with the offset tells how sure it is; an end of the search is
  // not.
  if (at > 0 && at + 1 < static_cast<int>(costs.size())) {
    const Agreement later = At(offset + kStep);
    double information = 0;
    for (std::size_t i = 0; i < turns_.size(); ++i) {
      const double weight = 1 / (1 + std::pow(best.residuals[i].norm() / (2 * best.scale), 2));
      information += weight * ((later.expected[i] - best.expected[i]) / kStep).squaredNorm();
    }
    if (information > 0) check.time_offset_sigma = best.scale / std::sqrt(information);
  }
  ReadRotation(best, check);
}

void Checker::ReadRotation(const Agreement& best, ImuCheck& check) const {
  Matrix3d information = Matrix3d::Zero();
  double both = 0, gyroscope = 0;
  for (std::size_t i = 0; i < turns_.size(); ++i) {
    const Vector3d& v = best.expected[i];
    if (best.residuals[i].norm() > 6 * best.scale) continue;
    information += v.squaredNorm() * Matrix3d::Identity() - v * v.transpose();
    both += turns_[i].vector.dot(v);
    gyroscope += v.squaredNorm();
  }
  check.turn_ratio = gyroscope > 0 ? both / gyroscope : 0;
  if (!free_rotation_) return;
  // cam_from_body = Exp(-rotation) * calibrated.
  check.rotation =
      -LogSO3(Eigen::Quaterniond(Matrix3d(best.cam_from_body * calibrated_.transpose())));
  const double least =
      Eigen::SelfAdjointEigenSolver<Matrix3d>(information).eigenvalues().minCoeff();
  if (least > 0) check.rotation_sigma = best.scale / std::sqrt(least);
}

}  // namespace

std::optional<VisualTurn> EstimateTurn(const DistortedCamera& camera, const RawMotion& motion) {
  std::vector<RawMatch> matches;
  for (std::size_t i = 0; i < motion.from.size(); ++i) {
    matches.push_back({.left = motion.from[i], .right = motion.to[i]});
  }
  std::vector<RayMatch> rays = ToRays(TwoTimes(camera, Matrix3d::Identity(), {1, 0, 0}), matches);
  std::erase_if(rays, [](const RayMatch& ray) { return !ray.valid; });
  if (rays.size() < kMinPoints) return std::nullopt;
  std::optional<VisualTurn> best;
  double least = std::numeric_limits<double>::infinity();
  for (const StereoRig& start : Starts(camera, rays)) {
    const RigFit fit = FitRig(start, rays, {.turn = true});
    if (fit.noise >= least) continue;
    least = fit.noise;
    const Eigen::Quaterniond turn =
        start.right.body_from_cam.rotation * ExpSO3(fit.correction.turn);
    best = VisualTurn{motion.from_ns, motion.to_ns, LogSO3(turn), fit.sigma.turn.maxCoeff()};
  }
  constexpr double kMaxNoise = 2;  // pixels
  return least < kMaxNoise ? best : std::nullopt;
}

ImuCheck CheckImu(const StereoRig& rig, const std::vector<ImuSample>& imu,
                  const std::vector<VisualTurn>& turns) {
  return Checker(rig, imu, turns).Run();
}

}  // namespace airslam
