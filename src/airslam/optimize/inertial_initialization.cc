// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/inertial_initialization.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "airslam/common/error.h"
#include "airslam/geometry/so3.h"
#include "airslam/optimize/inertial_refinement.h"
#include "airslam/optimize/time_offset.h"

namespace airslam {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kDegrees = 180 / std::numbers::pi;

// Two directions across `direction` (columns, unit length).
Eigen::Matrix<double, 3, 2> Across(const Vector3d& direction) {
  Eigen::Matrix<double, 3, 2> across;
  across.col(0) = direction.unitOrthogonal();
  across.col(1) = direction.normalized().cross(across.col(0));
  return across;
}

class Initializer {
 public:
  Initializer(const InertialInitializationOptions& options,
              const std::vector<InertialFrame>& frames, const ImuBuffer& imu, const ImuNoise& noise,
              const Rigid3& body_from_cam)
      : options_(options),
        frames_(frames),
        imu_(imu),
        noise_(noise),
        body_from_cam_(body_from_cam) {
    for (const InertialFrame& frame : frames) {
      bodies_.push_back(frame.world_from_cam * body_from_cam.Inverse());
    }
  }

  InertialInitialization Run() {
    if (!CheckInput()) return result_;
    if (IsAtRest()) {
      InitializeAtRest();
      return result_;
    }
    if (!CheckMotion()) return result_;
    Preintegrate();
    SolveGyroscopeBias();
    if (!CheckTimeOffset()) return result_;
    SolveVelocitiesAndGravity();
    if (!CheckGravity()) return result_;
    for (int i = 0; i < 3; ++i) SolveAccelerometerBias();
    for (ImuPreintegration& part : between_) part.Reintegrate(result_.bias);
    RefineInertial(options_, frames_, between_, body_from_cam_, result_);
    CheckEstimate();
    return result_;
  }

 private:
  template <typename... Args>
  bool Refuse(InertialRefusal refusal, fmt::format_string<Args...> format, Args&&... args) {
    result_.refusal = refusal;
    result_.reason = fmt::format(format, std::forward<Args>(args)...);
    return false;
  }

  int size() const { return static_cast<int>(frames_.size()); }
  double Duration() const {
    return 1e-9 * static_cast<double>(frames_.back().timestamp_ns - frames_.front().timestamp_ns);
  }

  bool CheckInput();
  bool IsAtRest();
  void InitializeAtRest();
  bool CheckMotion();
  void Preintegrate();
  void SolveGyroscopeBias();
  bool CheckTimeOffset();
  void SolveVelocitiesAndGravity();
  bool CheckGravity();
  void SolveAccelerometerBias();
  bool CheckEstimate();

  // Rows of the linear systems: what interval i says of velocities (3 a frame) and gravity.
  struct IntervalRows {
    double velocity_weight, position_weight;
    Vector3d velocity, position;  // right-hand sides, in world
  };
  IntervalRows RowsOf(int i) const;

  const InertialInitializationOptions& options_;
  const std::vector<InertialFrame>& frames_;
  const ImuBuffer& imu_;
  const ImuNoise& noise_;
  const Rigid3 body_from_cam_;
  std::vector<Rigid3> bodies_;  // world_from_body
  std::vector<ImuPreintegration> between_;
  Vector3d mean_gyroscope_ = Vector3d::Zero(), mean_accelerometer_ = Vector3d::Zero();
  InertialInitialization result_;
};

bool Initializer::CheckInput() {
  for (int i = 0; i < size(); ++i) {
    if (!bodies_[i].translation.allFinite() || !bodies_[i].rotation.coeffs().allFinite()) {
      return Refuse(InertialRefusal::kInconsistent, "the pose of frame {} is not finite", i);
    }
  }
  for (int i = 1; i < size(); ++i) {
    if (frames_[i].timestamp_ns <= frames_[i - 1].timestamp_ns) {
      return Refuse(InertialRefusal::kInconsistent,
                    "frames are not in order of time: frame {} is not after the one before it", i);
    }
  }
  if (size() < 2 || Duration() < std::min(options_.min_rest, options_.min_duration)) {
    return Refuse(InertialRefusal::kTooShort, "{} frames over {:.2f} s: {:.2f} s are needed",
                  size(), size() < 2 ? 0.0 : Duration(),
                  std::min(options_.min_rest, options_.min_duration));
  }
  const ImuInterval all = imu_.Between(frames_.front().timestamp_ns, frames_.back().timestamp_ns);
  if (!all.complete()) {
    return Refuse(InertialRefusal::kImuGap,
                  "IMU readings are missing: the largest gap is {:.3f} s, {:.0f} % of {:.2f} s are "
                  "covered",
                  all.largest_gap, 100 * all.coverage, Duration());
  }
  if (all.saturated > 0) {
    return Refuse(InertialRefusal::kSaturated, "{} IMU readings reach the end of the scale",
                  all.saturated);
  }
  return true;
}

bool Initializer::IsAtRest() {
  const std::vector<ImuSample> samples =
      imu_.Between(frames_.front().timestamp_ns, frames_.back().timestamp_ns).samples;
  Vector3d gyroscope_square = Vector3d::Zero(), accelerometer_square = Vector3d::Zero();
  const double count = static_cast<double>(samples.size());
  for (const ImuSample& sample : samples) {
    mean_gyroscope_ += sample.angular_velocity / count;
    mean_accelerometer_ += sample.acceleration / count;
  }
  for (const ImuSample& sample : samples) {
    gyroscope_square += (sample.angular_velocity - mean_gyroscope_).cwiseAbs2() / count;
    accelerometer_square += (sample.acceleration - mean_accelerometer_).cwiseAbs2() / count;
  }
  for (const Rigid3& body : bodies_) {
    const Rigid3 moved = bodies_.front().Inverse() * body;
    if (moved.Angle() > options_.rest_rotation) return false;
    if (moved.translation.norm() > options_.rest_position) return false;
  }
  return std::sqrt(gyroscope_square.maxCoeff()) < options_.rest_gyroscope &&
         std::sqrt(accelerometer_square.maxCoeff()) < options_.rest_accelerometer;
}

void Initializer::InitializeAtRest() {
  result_.at_rest = true;
  if (Duration() < options_.min_rest) {
    Refuse(InertialRefusal::kTooShort, "at rest for {:.2f} s: {:.2f} s are needed", Duration(),
           options_.min_rest);
    return;
  }
  const double length = mean_accelerometer_.norm();
  if (std::abs(length - options_.gravity) > options_.max_gravity_error) {
    Refuse(InertialRefusal::kInconsistent, "at rest the accelerometer reads {:.2f} m/s^2", length);
    return;
  }
  const Vector3d up = mean_accelerometer_ / length;
  result_.gravity_in_world = -options_.gravity * (bodies_.front().rotation * up);
  result_.bias.gyroscope = mean_gyroscope_;
  result_.bias.accelerometer = (length - options_.gravity) * up;
  result_.velocities_in_world.assign(frames_.size(), Vector3d::Zero());
  result_.gravity_sigma = options_.sigma_accelerometer_bias / options_.gravity;
  // A turn that vision does not see may hide in the mean.
  result_.gyroscope_bias_sigma = std::hypot(noise_.gyroscope_noise_density / std::sqrt(Duration()),
                                            std::sqrt(2) * options_.sigma_rotation / Duration());
  result_.accelerometer_bias_sigma = options_.sigma_accelerometer_bias;
}

bool Initializer::CheckMotion() {
  if (size() >= options_.min_frames && Duration() >= options_.min_duration) return true;
  return Refuse(InertialRefusal::kTooShort,
                "{} frames over {:.2f} s: a moving start needs {} frames over {:.2f} s", size(),
                Duration(), options_.min_frames, options_.min_duration);
}

void Initializer::Preintegrate() {
  for (int i = 0; i + 1 < size(); ++i) {
    between_.emplace_back(
        imu_.Between(frames_[i].timestamp_ns, frames_[i + 1].timestamp_ns).samples, noise_,
        ImuBias{});
  }
}

// Gauss-Newton on the rotations alone.
void Initializer::SolveGyroscopeBias() {
  for (int iteration = 0; iteration < 4; ++iteration) {
    Matrix3d information = Matrix3d::Zero();
    Vector3d right = Vector3d::Zero();
    for (int i = 0; i + 1 < size(); ++i) {
      const Matrix3d by_bias = between_[i].by_bias().topLeftCorner<3, 3>();
      const Vector3d error = LogSO3(between_[i].delta().rotation.conjugate() *
                                    bodies_[i].rotation.conjugate() * bodies_[i + 1].rotation);
      information += by_bias.transpose() * by_bias;
      right += by_bias.transpose() * error;
    }
    result_.bias.gyroscope += information.ldlt().solve(right);
    for (ImuPreintegration& part : between_) part.Reintegrate(result_.bias);
  }
}

bool Initializer::CheckTimeOffset() {
  const TimeOffsetEstimate estimate =
      EstimateTimeOffset(options_, frames_, imu_, result_.bias.gyroscope, body_from_cam_);
  result_.time_offset = estimate.offset;
  result_.time_offset_sigma = estimate.sigma;
  if (estimate.sigma == 0 ||
      std::abs(estimate.offset) < std::max(options_.max_time_offset, 4 * estimate.sigma)) {
    return true;
  }
  return Refuse(InertialRefusal::kTimeOffset,
                "the IMU's time is off by {:+.1f} ms (standard deviation {:.1f} ms)",
                1e3 * estimate.offset, 1e3 * estimate.sigma);
}

Initializer::IntervalRows Initializer::RowsOf(int i) const {
  const ImuPreintegration& part = between_[i];
  const double t = part.duration();
  const ImuDelta delta = part.Corrected(result_.bias);
  const double tilt = options_.sigma_rotation * options_.gravity * t;
  IntervalRows rows;
  rows.velocity_weight =
      1 / std::sqrt(part.covariance().diagonal().segment<3>(3).maxCoeff() + tilt * tilt);
  rows.position_weight = 1 / (std::sqrt(2) * options_.sigma_position);
  rows.velocity = bodies_[i].rotation * delta.velocity;
  rows.position =
      bodies_[i + 1].translation - bodies_[i].translation - bodies_[i].rotation * delta.position;
  return rows;
}

// Linear least squares: v_j - v_i - g T = R_i dv and v_i T + g T^2 / 2 = p_j - p_i - R_i dp.
void Initializer::SolveVelocitiesAndGravity() {
  const int columns = 3 * size() + 3, gravity = 3 * size();
  Eigen::MatrixXd a = Eigen::MatrixXd::Zero(6 * (size() - 1), columns);
  Eigen::VectorXd b(a.rows());
  for (int i = 0; i + 1 < size(); ++i) {
    const IntervalRows rows = RowsOf(i);
    const double t = between_[i].duration();
    const Matrix3d v = rows.velocity_weight * Matrix3d::Identity();
    const Matrix3d p = rows.position_weight * Matrix3d::Identity();
    a.block<3, 3>(6 * i, 3 * i) = -v;
    a.block<3, 3>(6 * i, 3 * i + 3) = v;
    a.block<3, 3>(6 * i, gravity) = -t * v;
    a.block<3, 3>(6 * i + 3, 3 * i) = t * p;
    a.block<3, 3>(6 * i + 3, gravity) = 0.5 * t * t * p;
    b.segment<3>(6 * i) = rows.velocity_weight * rows.velocity;
    b.segment<3>(6 * i + 3) = rows.position_weight * rows.position;
  }
  const Eigen::VectorXd x = a.colPivHouseholderQr().solve(b);
  result_.velocities_in_world.resize(frames_.size());
  for (int i = 0; i < size(); ++i) result_.velocities_in_world[i] = x.segment<3>(3 * i);
  result_.gravity_in_world = x.tail<3>();
}

bool Initializer::CheckGravity() {
  const double length = result_.gravity_in_world.norm();
  if (!(std::abs(length - options_.gravity) <= options_.max_gravity_error)) {
    return Refuse(InertialRefusal::kInconsistent,
                  "poses and readings give a gravity of {:.2f} m/s^2: scale, calibration or time "
                  "offset are wrong",
                  length);
  }
  result_.gravity_in_world *= options_.gravity / length;
  return true;
}

// The same with gravity turned within its tangent plane, the accelerometer's bias and its prior.
void Initializer::SolveAccelerometerBias() {
  const int tangent = 3 * size(), bias = tangent + 2;
  const Eigen::Matrix<double, 3, 2> across = Across(result_.gravity_in_world);
  Eigen::MatrixXd a = Eigen::MatrixXd::Zero(6 * (size() - 1) + 3, bias + 3);
  Eigen::VectorXd b = Eigen::VectorXd::Zero(a.rows());
  for (int i = 0; i + 1 < size(); ++i) {
    const IntervalRows rows = RowsOf(i);
    const double t = between_[i].duration();
    const double v = rows.velocity_weight, p = rows.position_weight;
    const Matrix3d r = bodies_[i].rotation.toRotationMatrix();
    a.block<3, 3>(6 * i, 3 * i) = -v * Matrix3d::Identity();
    a.block<3, 3>(6 * i, 3 * i + 3) = v * Matrix3d::Identity();
    a.block<3, 2>(6 * i, tangent) = -v * t * across;
    a.block<3, 3>(6 * i, bias) = -v * r * between_[i].by_bias().block<3, 3>(3, 3);
    a.block<3, 3>(6 * i + 3, 3 * i) = p * t * Matrix3d::Identity();
    a.block<3, 2>(6 * i + 3, tangent) = 0.5 * p * t * t * across;
    a.block<3, 3>(6 * i + 3, bias) = p * r * between_[i].by_bias().block<3, 3>(6, 3);
    b.segment<3>(6 * i) = v * (rows.velocity + t * result_.gravity_in_world);
    b.segment<3>(6 * i + 3) = p * (rows.position - 0.5 * t * t * result_.gravity_in_world);
  }
  // `rows` holds the bias of the last round: the unknown is its change, the prior is on the sum.
  a.bottomRightCorner<3, 3>() = Matrix3d::Identity() / options_.sigma_accelerometer_bias;
  b.tail<3>() = -result_.bias.accelerometer / options_.sigma_accelerometer_bias;
  const Eigen::VectorXd x = a.colPivHouseholderQr().solve(b);
  for (int i = 0; i < size(); ++i) result_.velocities_in_world[i] = x.segment<3>(3 * i);
  const Vector3d turned = result_.gravity_in_world + across * x.segment<2>(tangent);
  result_.gravity_in_world = options_.gravity * turned.normalized();
  result_.bias.accelerometer += x.tail<3>();
}

bool Initializer::CheckEstimate() {
  if (!(result_.residual <= options_.max_residual)) {
    return Refuse(
        InertialRefusal::kInconsistent,
        "poses and readings disagree by {:.1f} standard deviations: time offset, noise or "
        "calibration are wrong",
        result_.residual);
  }
  if (!(result_.gravity_sigma <= options_.max_gravity_sigma &&
        result_.gyroscope_bias_sigma <= options_.max_gyroscope_bias_sigma &&
        result_.accelerometer_bias_sigma <= options_.max_accelerometer_bias_sigma)) {
    return Refuse(
        InertialRefusal::kNotExcited,
        "the motion leaves gravity uncertain by {:.2f} degrees, the biases by {:.4f} rad/s "
        "and {:.3f} m/s^2",
        kDegrees * result_.gravity_sigma, result_.gyroscope_bias_sigma,
        result_.accelerometer_bias_sigma);
  }
  return true;
}

}  // namespace

void InertialInitializationOptions::Validate() const {
  const auto positive = [](double value, const char* name) {
    if (!(value > 0)) Fail("{} is {}: expected more than 0", name, value);
  };
  if (min_frames < 3) Fail("min_frames is {}: expected at least 3", min_frames);
  positive(min_duration, "min_duration");
  positive(min_rest, "min_rest");
  positive(gravity, "gravity");
  positive(sigma_rotation, "sigma_rotation");
  positive(sigma_position, "sigma_position");
  positive(sigma_accelerometer_bias, "sigma_accelerometer_bias");
  positive(max_residual, "max_residual");
  positive(time_offset_step, "time_offset_step");
  if (!(time_offset_search >= time_offset_step)) {
    Fail("time_offset_search is {} s: expected at least the step of {} s", time_offset_search,
         time_offset_step);
  }
}

std::string_view ToString(InertialRefusal refusal) {
  switch (refusal) {
    case InertialRefusal::kNone:
      return "none";
    case InertialRefusal::kTooShort:
      return "too short";
    case InertialRefusal::kImuGap:
      return "IMU gap";
    case InertialRefusal::kSaturated:
      return "IMU saturated";
    case InertialRefusal::kTimeOffset:
      return "time offset";
    case InertialRefusal::kNotExcited:
      return "not excited";
    case InertialRefusal::kInconsistent:
      return "inconsistent";
  }
  return "unknown";
}

InertialInitialization InitializeInertial(const InertialInitializationOptions& options,
                                          const std::vector<InertialFrame>& frames,
                                          const ImuBuffer& imu, const ImuNoise& noise,
                                          const Rigid3& body_from_cam) {
  options.Validate();
  return Initializer(options, frames, imu, noise, body_from_cam).Run();
}

}  // namespace airslam
