// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/inertial_filter.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <random>

#include "airslam/geometry/so3.h"
#include "airslam/sensor/imu_buffer.h"
#include "airslam/testing/synthetic_motion.h"

namespace airslam {
namespace {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Vector15d = Eigen::Matrix<double, 15, 1>;

constexpr std::int64_t kStart = 1'700'000'000'000'000'000;
constexpr std::int64_t kFrame = 100'000'000;
const Rigid3 kBodyFromCam{Eigen::Quaterniond(0.7, -0.1, 0.2, 0.68), {0.06, -0.02, 0.1}};
const ImuNoise kNoise{1e-3, 2e-4, 1e-2, 1e-2, 200};
constexpr double kRotation = 2e-3, kPosition = 5e-3;  // standard deviations of the poses seen

Vector6d Difference(const Rigid3& from, const Rigid3& to) {
  Vector6d error;
  error << LogSO3(from.rotation.conjugate() * to.rotation), to.translation - from.translation;
  return error;
}

Rigid3 Moved(const Rigid3& pose, const Vector6d& error) {
  return {pose.rotation * ExpSO3(error.head<3>()), pose.translation + error.tail<3>()};
}

// A filter that follows a seeded run of an IMU and of noisy camera poses.
class FilterRun {
 public:
  explicit FilterRun(std::uint32_t seed) : random_(seed) {
    ImuSimulationOptions options;
    options.noise = kNoise;
    options.seed = seed;
    options.gyroscope_bias = 0.01 * Random3();
    options.accelerometer_bias = 0.1 * Random3();
    recording_ = SimulateImu(motion_, kStart, kStart + 60 * kFrame, options);
    buffer_.emplace(recording_.samples, ImuBufferOptions());
    Matrix15d covariance = Matrix15d::Zero();
    covariance.diagonal() << Eigen::Vector3d::Constant(1e-6), Eigen::Vector3d::Constant(0.01),
        Eigen::Vector3d::Constant(1e-6), Eigen::Vector3d::Constant(1e-4),
        Eigen::Vector3d::Constant(0.01);
    const BodyState truth = motion_.At(kStart);
    const InertialState start{Rigid3(truth.world_from_body.rotation * ExpSO3(1e-3 * Random3()),
                                     truth.world_from_body.translation + 1e-3 * Random3()),
                              truth.velocity_in_world + 0.1 * Random3(),
                              {}};
    filter_ = InertialFilter(kStart, start, covariance, kBodyFromCam);
  }

  // The next frame; vision may be blind.
  void Step(bool blind) {
    const std::int64_t now = filter_.timestamp_ns();
    filter_.Propagate({buffer_->Between(now, now + kFrame).samples, kNoise, filter_.state().bias},
                      kGravityInWorld);
    if (blind) return;
    Vector6d sigma;
    sigma << Eigen::Vector3d::Constant(kRotation), Eigen::Vector3d::Constant(kPosition);
    const Matrix6d vision = sigma.cwiseAbs2().asDiagonal();
    Vector6d noise;
    noise << Random3(), Random3();
    const Rigid3 truth = motion_.At(now + kFrame).world_from_body * kBodyFromCam;
    const Rigid3 measured = Moved(truth, sigma.cwiseProduct(noise));
    // What motion-only optimization would make of the points and the prior.
    const PosePrior prior = filter_.Prior();
    const Matrix6d known = (prior.weight.transpose() * prior.weight).inverse();
    VisualPose seen;
    seen.world_from_cam =
        Moved(prior.world_from_cam,
              known * (known + vision).inverse() * Difference(prior.world_from_cam, measured));
    seen.information = vision.inverse();
    filter_.Correct(seen);
  }

  Vector15d Error() const {
    const BodyState truth = motion_.At(filter_.timestamp_ns());
    const InertialState& state = filter_.state();
    const auto k = static_cast<std::size_t>((filter_.timestamp_ns() - kStart) / 5'000'000);
    Vector15d error;
    error << LogSO3(state.world_from_body.rotation.conjugate() * truth.world_from_body.rotation),
        truth.velocity_in_world - state.velocity_in_world,
        truth.world_from_body.translation - state.world_from_body.translation,
        recording_.gyroscope_biases[k] - state.bias.gyroscope,
        recording_.accelerometer_biases[k] - state.bias.accelerometer;
    return error;
  }

  const InertialFilter& filter() const { return filter_; }

 private:
  Eigen::Vector3d Random3() {
    std::normal_distribution<double> normal;
    return {normal(random_), normal(random_), normal(random_)};
  }

  std::mt19937 random_;
  SyntheticTrajectory motion_ =
      SyntheticTrajectory::Loop(10, 3).Mount(Eigen::Quaterniond(0.5, 0.5, -0.5, 0.5), kStart);
  ImuRecording recording_;
  std::optional<ImuBuffer> buffer_;
  InertialFilter filter_;
};

// Mean of e' P^-1 e over seeded runs of 5 s, of pose, of velocity, and of the whole state. With n
// degrees of freedom its 95 % bounds are n +- 1.96 sqrt(2 n / runs).
TEST(InertialFilter, IsConsistentOverMonteCarloRuns) {
  constexpr int kRuns = 120;
  for (const int blind_frames : {0, 10}) {
    double whole = 0, velocity = 0, position = 0;
    for (int run = 0; run < kRuns; ++run) {
      FilterRun filter(1000 + run);
      for (int k = 0; k < 50; ++k) filter.Step(k >= 50 - blind_frames);
      const Vector15d error = filter.Error();
      const Matrix15d& p = filter.filter().covariance();
      whole += error.dot(p.llt().solve(error)) / kRuns;
      const Eigen::Vector3d v = error.segment<3>(3), x = error.segment<3>(6);
      velocity += v.dot(p.block<3, 3>(3, 3).llt().solve(v)) / kRuns;
      position += x.dot(p.block<3, 3>(6, 6).llt().solve(x)) / kRuns;
    }
    EXPECT_NEAR(whole, 15, 1.96 * std::sqrt(2 * 15.0 / kRuns)) << blind_frames;
    EXPECT_NEAR(velocity, 3, 1.96 * std::sqrt(2 * 3.0 / kRuns)) << blind_frames;
    EXPECT_NEAR(position, 3, 1.96 * std::sqrt(2 * 3.0 / kRuns)) << blind_frames;
  }
}

TEST(InertialFilter, FindsTheBiasesAndTheVelocity) {
  FilterRun run(7);
  for (int k = 0; k < 50; ++k) run.Step(false);
  EXPECT_LT(run.Error().segment<3>(3).norm(), 0.02);
  EXPECT_LT(run.Error().segment<3>(9).norm(), 0.003);
  EXPECT_LT(run.Error().segment<3>(12).norm(), 0.06);
}

TEST(InertialFilter, IsLessSureTheLongerItIsBlind) {
  FilterRun run(7);
  for (int k = 0; k < 30; ++k) run.Step(false);
  const double seeing = run.filter().SigmaPosition();
  EXPECT_LT(seeing, kPosition);
  for (int k = 0; k < 5; ++k) run.Step(true);
  const double half_a_second = run.filter().SigmaPosition();
  for (int k = 0; k < 5; ++k) run.Step(true);
  EXPECT_GT(half_a_second, 2 * seeing);
  EXPECT_GT(run.filter().SigmaPosition(), 2 * half_a_second);
  EXPECT_GT(run.filter().Prior().SigmaPosition(), half_a_second);
}

// Where points say nothing the filter learns nothing, and takes over the pose as it is.
TEST(InertialFilter, APoseWithoutInformationTeachesNothing) {
  FilterRun run(7);
  for (int k = 0; k < 30; ++k) run.Step(false);
  InertialFilter filter = run.filter();
  filter.Correct({filter.world_from_cam(), Matrix6d::Zero(), 0, 0});
  EXPECT_LT((filter.covariance() - run.filter().covariance()).norm(),
            1e-4 * run.filter().covariance().norm());
  EXPECT_LT((filter.state().velocity_in_world - run.filter().state().velocity_in_world).norm(),
            1e-9);
}

}  // namespace
}  // namespace airslam
