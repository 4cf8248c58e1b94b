// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/sensor/imu_preintegration.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <filesystem>
#include <iostream>

#include "airslam/common/error.h"
#include "airslam/geometry/so3.h"
#include "airslam/sensor/imu_buffer.h"
#include "airslam/testing/recorded_motion.h"
#include "airslam/testing/synthetic_motion.h"

namespace airslam {
namespace {

using Vector9d = Eigen::Matrix<double, 9, 1>;
using Vector15d = Eigen::Matrix<double, 15, 1>;

constexpr std::int64_t kStart = 1'700'000'000'000'000'000;
const Eigen::Quaterniond kMounting(0.5, 0.5, -0.5, 0.5);

SyntheticTrajectory Motion() {
  auto trajectory = SyntheticTrajectory::Loop(10, 3);
  trajectory.Mount(kMounting, kStart);
  return trajectory;
}

std::int64_t After(double seconds) { return kStart + std::llround(seconds * 1e9); }

InertialState StateOf(const BodyState& state, const ImuBias& bias = {}) {
  return {state.world_from_body, state.velocity_in_world, bias};
}

ImuPreintegration Integrate(const std::vector<ImuSample>& samples, double begin, double end,
                            const ImuNoise& noise, const ImuBias& bias) {
  const ImuBuffer buffer(samples, {});
  return {buffer.Between(After(begin), After(end)).samples, noise, bias};
}

// (rotation, velocity, position) of `actual` as seen from `expected`, in the frame of the errors.
Vector9d Difference(const ImuDelta& expected, const ImuDelta& actual) {
  Vector9d difference;
  difference << LogSO3(expected.rotation.conjugate() * actual.rotation),
      actual.velocity - expected.velocity, actual.position - expected.position;
  return difference;
}

TEST(GyroscopeTurn, IsThePreintegratedRotation) {
  ImuSimulationOptions options;
  options.noise.rate_hz = 200;
  const ImuRecording recording = SimulateImu(Motion(), kStart, After(1), options);
  const ImuBias bias{{0.01, -0.02, 0.03}, {}};
  const ImuPreintegration expected = Integrate(recording.samples, 0.1, 0.9, {}, bias);
  const Eigen::Quaterniond turn = GyroscopeTurn(expected.samples(), bias.gyroscope);
  EXPECT_GT(LogSO3(turn).norm(), 0.1);
  EXPECT_LT(LogSO3(expected.delta().rotation.conjugate() * turn).norm(), 1e-12);
  EXPECT_LT(LogSO3(GyroscopeTurn({}, bias.gyroscope)).norm(), 1e-12);
}

TEST(ImuPreintegration, FollowsTheExactMotion) {
  const SyntheticTrajectory motion = Motion();
  ImuSimulationOptions options;
  options.gyroscope_bias = {0.01, -0.02, 0.03};
  options.accelerometer_bias = {0.1, 0.2, -0.1};
  const ImuBias bias{options.gyroscope_bias, options.accelerometer_bias};
  for (const double rate : {200.0, 400.0}) {
    options.noise.rate_hz = rate;
    const ImuRecording recording = SimulateImu(motion, kStart, After(3), options);
    // From and to times between the readings.
    const ImuPreintegration integrated =
        Integrate(recording.samples, 0.3012, 2.3037, options.noise, bias);
    EXPECT_NEAR(integrated.duration(), 2.0025, 1e-9);
    const InertialState end =
        Predict(StateOf(motion.At(After(0.3012)), bias), integrated, kGravityInWorld);
    const BodyState truth = motion.At(After(2.3037));
    const double scale = 200 * 200 / (rate * rate);  // second order in the step
    EXPECT_LT((truth.world_from_body.Inverse() * end.world_from_body).Angle(), 2e-5 * scale);
    EXPECT_LT((end.velocity_in_world - truth.velocity_in_world).norm(), 1.5e-4 * scale);
    EXPECT_LT((end.world_from_body.translation - truth.world_from_body.translation).norm(),
              1.5e-4 * scale);
  }
}

TEST(ImuPreintegration, BiasJacobiansMatchNumericDifferences) {
  ImuSimulationOptions options;
  options.noise.rate_hz = 100;
  const ImuRecording recording = SimulateImu(Motion(), kStart, After(2), options);
  const ImuBias bias{{0.02, 0.01, -0.03}, {0.2, -0.1, 0.3}};
  const ImuPreintegration at = Integrate(recording.samples, 0, 1, options.noise, bias);
  constexpr double kStep = 1e-5;
  for (int i = 0; i < 6; ++i) {
    ImuBias plus = bias, minus = bias;
    (i < 3 ? plus.gyroscope : plus.accelerometer)[i % 3] += kStep;
    (i < 3 ? minus.gyroscope : minus.accelerometer)[i % 3] -= kStep;
    const Vector9d numeric =
        (Difference(at.delta(), Integrate(recording.samples, 0, 1, {}, plus).delta()) -
         Difference(at.delta(), Integrate(recording.samples, 0, 1, {}, minus).delta())) /
        (2 * kStep);
    EXPECT_LT((at.by_bias().col(i) - numeric).norm(), 2e-4 * numeric.norm()) << i;
    // A first-order step.
    const ImuDelta corrected = at.Corrected(plus);
    EXPECT_LT(Difference(Integrate(recording.samples, 0, 1, {}, plus).delta(), corrected).norm(),
              1e-8);
  }
}

TEST(ImuPreintegration, IntegratesAgainWhereTheBiasIsFar) {
  ImuSimulationOptions options;
  options.noise.rate_hz = 200;
  const ImuRecording recording = SimulateImu(Motion(), kStart, After(2), options);
  ImuPreintegration integrated = Integrate(recording.samples, 0, 1, options.noise, {});
  const ImuBias far{{0.05, 0.05, -0.05}, {0.1, 0, 0}};
  const ImuDelta exact = Integrate(recording.samples, 0, 1, options.noise, far).delta();
  EXPECT_TRUE(integrated.IsFar(far));
  EXPECT_FALSE(integrated.IsFar({{0.005, 0, 0}, {10, 0, 0}}));
  EXPECT_GT(Difference(exact, integrated.Corrected(far)).norm(), 1e-3);  // first order misses it
  integrated.Reintegrate(far);
  EXPECT_LT(Difference(exact, integrated.delta()).norm(), 1e-12);
  EXPECT_FALSE(integrated.IsFar(far));
}

TEST(ImuPreintegration, JoinsWhatFollowsEachOther) {
  ImuSimulationOptions options;
  options.noise = {1e-3, 1e-4, 1e-2, 1e-3, 200};
  const ImuRecording recording = SimulateImu(Motion(), kStart, After(2), options);
  const auto part = [&](double begin, double end) {
    return Integrate(recording.samples, begin, end, options.noise, {});
  };
  const ImuPreintegration whole = part(0.1, 1.3), joined = Join(part(0.1, 0.702), part(0.702, 1.3));
  EXPECT_NEAR(joined.duration(), 1.2, 1e-9);
  EXPECT_LT(Difference(whole.delta(), joined.delta()).norm(), 1e-5);  // the step was split
  EXPECT_LT((whole.covariance() - joined.covariance()).norm(), 1e-2 * whole.covariance().norm());
  // State by state over the parts is the same as over the whole.
  const InertialState start = StateOf(Motion().At(After(0.1)));
  const InertialState once = Predict(start, joined, kGravityInWorld);
  const InertialState twice =
      Predict(Predict(start, part(0.1, 0.702), kGravityInWorld), part(0.702, 1.3), kGravityInWorld);
  EXPECT_LT((once.world_from_body.Inverse() * twice.world_from_body).Angle(), 1e-9);
  EXPECT_LT((once.velocity_in_world - twice.velocity_in_world).norm(), 1e-9);
  EXPECT_LT((once.world_from_body.translation - twice.world_from_body.translation).norm(), 1e-9);
  EXPECT_THROW(Join(part(0.1, 0.7), part(0.8, 1.3)), Error);
  EXPECT_THROW(Join(part(0.1, 0.7), ImuPreintegration()), Error);
}

TEST(ImuPreintegration, SpansNoTimeWithoutSamples) {
  const ImuPreintegration none({}, {}, {});
  EXPECT_EQ(none.duration(), 0);
  EXPECT_EQ(none.delta().velocity, Eigen::Vector3d::Zero());
  EXPECT_EQ(none.covariance(), Matrix9d::Zero());
}

// Mean of x' P^-1 x over seeded runs of states of kSize errors, which has the mean kSize and the
// standard deviation sqrt(2 kSize / runs) when P is right.
TEST(ImuPreintegration, CovarianceMatchesMonteCarlo) {
  const SyntheticTrajectory motion = Motion();
  ImuSimulationOptions options;
  options.noise = {2e-3, 1e-3, 2e-2, 2e-2, 200};
  ImuSimulationOptions exact;
  exact.noise.rate_hz = 200;
  const ImuDelta truth =
      Integrate(SimulateImu(motion, kStart, After(2), exact).samples, 0, 1.5, {}, {}).delta();
  constexpr int kRuns = 600;
  double nees = 0, prediction_nees = 0;
  Matrix9d sampled = Matrix9d::Zero();
  Matrix9d covariance;
  for (int run = 0; run < kRuns; ++run) {
    options.seed = 100 + run;
    const ImuRecording recording = SimulateImu(motion, kStart, After(2), options);
    const ImuPreintegration integrated = Integrate(recording.samples, 0, 1.5, options.noise, {});
    covariance = integrated.covariance();
    const Vector9d error = Difference(integrated.delta(), truth);
    nees += error.dot(covariance.llt().solve(error)) / kRuns;
    sampled += error * error.transpose() / kRuns;
    // The whole state, in two steps, from a start that is known well.
    InertialState state = StateOf(motion.At(kStart));
    Matrix15d p = 1e-14 * Matrix15d::Identity();
    for (const double begin : {0.0, 0.75}) {
      const auto step = Integrate(recording.samples, begin, begin + 0.75, options.noise, {});
      p = PredictCovariance(state, p, step);
      state = Predict(state, step, kGravityInWorld);
    }
    const BodyState end = motion.At(After(1.5));
    Vector15d x;
    x << LogSO3(state.world_from_body.rotation.conjugate() * end.world_from_body.rotation),
        end.velocity_in_world - state.velocity_in_world,
        end.world_from_body.translation - state.world_from_body.translation,
        recording.gyroscope_biases[300], recording.accelerometer_biases[300];
    prediction_nees += x.dot(p.llt().solve(x)) / kRuns;
  }
  EXPECT_NEAR(nees, 9, 4 * std::sqrt(2 * 9.0 / kRuns));
  EXPECT_NEAR(prediction_nees, 15, 4 * std::sqrt(2 * 15.0 / kRuns));
  for (int i = 0; i < 9; ++i) EXPECT_NEAR(sampled(i, i) / covariance(i, i), 1, 0.25) << i;
}

// --- Recorded data -------------------------------------------------------------------------------

const std::filesystem::path kData = std::filesystem::path(AIRSLAM_SOURCE_DIR) / "../shared/data";

struct Errors {
  std::vector<double> rotation, velocity, position;

  void Add(const InertialState& end, const RecordedState& truth) {
    rotation.push_back((truth.world_from_body.Inverse() * end.world_from_body).Angle());
    velocity.push_back((end.velocity_in_world - truth.velocity_in_world).norm());
    position.push_back(
        (end.world_from_body.translation - truth.world_from_body.translation).norm());
  }
  static double Median(std::vector<double> values) {
    std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
    return values[values.size() / 2];
  }
};

TEST(ImuPreintegrationData, FollowsTheWarehouse) {
  const std::filesystem::path mav = kData / "warehouse_day/mav0";
  if (!std::filesystem::exists(mav)) GTEST_SKIP() << mav << " is not there: nothing to compare";
  const auto states = ReadRecordedStates(mav / "state_groundtruth_estimate0/data.csv");
  const ImuBuffer buffer(ReadRecordedImu(mav / "imu0/data.csv"), {});
  const ImuNoise noise{1.6968e-4, 1.9393e-5, 2e-3, 3e-3, 200};
  const Eigen::Vector3d gravity(0, 0, -9.81);
  Errors errors;
  double nees = 0;
  for (std::size_t i = 0; i + 100 < states.size(); i += 20) {  // half a second each
    const RecordedState& begin = states[i];
    const RecordedState& end = states[i + 100];
    const InertialState start{begin.world_from_body,
                              begin.velocity_in_world,
                              {begin.gyroscope_bias, begin.accelerometer_bias}};
    const ImuPreintegration integrated(buffer.Between(begin.timestamp_ns, end.timestamp_ns).samples,
                                       noise, start.bias);
    const InertialState predicted = Predict(start, integrated, gravity);
    errors.Add(predicted, end);
    const double t = integrated.duration();
    const Eigen::Quaterniond back = begin.world_from_body.rotation.conjugate();
    const ImuDelta truth{
        back * end.world_from_body.rotation,
        back * (end.velocity_in_world - begin.velocity_in_world - t * gravity),
        back * (end.world_from_body.translation - begin.world_from_body.translation -
                t * begin.velocity_in_world - 0.5 * t * t * gravity)};
    const Vector9d error = Difference(integrated.delta(), truth);
    nees += error.dot(integrated.covariance().llt().solve(error));
  }
  nees /= static_cast<double>(errors.velocity.size());
  RecordProperty("nees", std::to_string(nees));
  std::cout << "median errors after 0.5 s: " << Errors::Median(errors.rotation) << " rad, "
            << Errors::Median(errors.velocity) << " m/s, " << Errors::Median(errors.position)
            << " m; mean NEES of 9: " << nees << "\n";
  EXPECT_LT(Errors::Median(errors.rotation), 3e-4);
  EXPECT_LT(Errors::Median(errors.velocity), 5e-3);
  EXPECT_LT(Errors::Median(errors.position), 1.5e-3);
  EXPECT_LT(nees, 13);
  EXPECT_GT(nees, 6);
}

// TartanAir v2: world z down, orientation as angles (a, b, c) of R = Rx(a) Ry(b) Rz(c), with which
// its accelerations and velocities agree to the last digit. Its gyro.txt does not: it is 0.15 rad/s
// (median) from the rate of that orientation. So the rate is made of the orientations here, and the
// accelerations are the recorded ones.
TEST(ImuPreintegrationData, FollowsTartanAir) {
  const std::filesystem::path imu = kData / "tartanair2_p000_10/imu";
  if (!std::filesystem::exists(imu)) GTEST_SKIP() << imu << " is not there: nothing to compare";
  const auto acc = ReadRows(imu / "acc.txt"), angles = ReadRows(imu / "ori_global.txt");
  const auto velocity = ReadRows(imu / "vel_global.txt");
  const auto position = ReadRows(imu / "pos_global.txt");
  const auto rotation = [&](std::size_t i) -> Eigen::Quaterniond {
    return Eigen::AngleAxisd(angles[i][0], Eigen::Vector3d::UnitX()) *
           Eigen::AngleAxisd(angles[i][1], Eigen::Vector3d::UnitY()) *
           Eigen::AngleAxisd(angles[i][2], Eigen::Vector3d::UnitZ());
  };
  std::vector<ImuSample> samples;
  std::vector<RecordedState> states;
  for (std::size_t i = 1; i + 1 < acc.size(); ++i) {
    const std::int64_t time = static_cast<std::int64_t>(i) * 10'000'000;
    samples.push_back({time, LogSO3(rotation(i - 1).conjugate() * rotation(i + 1)) / 0.02,
                       Eigen::Vector3d(acc[i].data())});
    RecordedState& state = states.emplace_back();
    state.timestamp_ns = time;
    state.world_from_body = Rigid3(rotation(i), Eigen::Vector3d(position[i].data()));
    state.velocity_in_world = Eigen::Vector3d(velocity[i].data());
  }
  Errors errors;
  const ImuBuffer buffer(samples, {});
  for (std::size_t i = 0; i + 50 < states.size(); i += 10) {
    const ImuPreintegration integrated(
        buffer.Between(states[i].timestamp_ns, states[i + 50].timestamp_ns).samples, {}, {});
    errors.Add(Predict({states[i].world_from_body, states[i].velocity_in_world, {}}, integrated,
                       Eigen::Vector3d(0, 0, 9.8)),
               states[i + 50]);
  }
  std::cout << "median errors after 0.5 s: " << Errors::Median(errors.rotation) << " rad, "
            << Errors::Median(errors.velocity) << " m/s, " << Errors::Median(errors.position)
            << " m\n";
  EXPECT_LT(Errors::Median(errors.rotation), 2e-3);
  EXPECT_LT(Errors::Median(errors.velocity), 1e-2);
  EXPECT_LT(Errors::Median(errors.position), 3e-3);
}

}  // namespace
}  // namespace airslam
