// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/cost_function.h>

#include <memory>
#include <vector>

#include "airslam/optimize/bias_walk_factor.h"
#include "airslam/optimize/inertial_factor.h"
#include "airslam/optimize/pose_prior_factor.h"
#include "airslam/sensor/imu_preintegration.h"

namespace airslam {

class KeptFactors;

// The inertial part of a bundle adjustment (paper, section V-E.3): velocities and biases of
// keyframes, and what the IMU says of them. Empty without an IMU.
struct InertialTerms {
  // A keyframe that has a velocity and biases.
  struct State {
    int pose = -1;                                                // of the bundle
    Eigen::Vector3d velocity_in_world = Eigen::Vector3d::Zero();  // of the body, m/s
    ImuBias bias;
  };
  // The readings between two states.
  struct Link {
    int from = -1, to = -1;  // of `states`
    std::shared_ptr<const ImuPreintegration> readings;
  };
  // What is known of a state's biases from before the bundle; every chain of links needs one.
  struct BiasPrior {
    int state = -1;  // of `states`
    ImuBias mean;
    Matrix6d covariance = Matrix6d::Identity();  // gyroscope (rad/s), accelerometer (m/s^2)
  };
  std::vector<State> states;
  std::vector<Link> links;
  std::vector<BiasPrior> priors;
  // m/s^2, points down: where it is expected, and with which standard deviation (rad); 0: it is
  // held.
  Eigen::Vector3d gravity_in_world = Eigen::Vector3d::Zero();
  double gravity_sigma = 0;
  Rigid3 body_from_cam;  // rectified left camera
};

// The factors of InertialTerms. The terms must outlive it.
class InertialBundle {
 public:
  // Throws Error when a link spans no time or a prior's covariance is not positive definite.
  explicit InertialBundle(const InertialTerms& terms);

  // Adds velocities, biases, gravity and the factors; this must outlive what they are added to. The
  // unknowns of the poses are those of the bundle's numbers.
  void AddTo(KeptFactors& kept);

  // Writes velocities, biases and gravity as `value` gives them by their unknown's number.
  template <class Value>
  void CopyTo(const Value& value, InertialTerms& terms) const {
    if (gravity_ < 0) return;
    terms.gravity_in_world = Eigen::Map<const Eigen::Vector3d>(value(gravity_));
    for (std::size_t i = 0; i < terms.states.size(); ++i) {
      InertialTerms::State& state = terms.states[i];
      state.velocity_in_world = Eigen::Map<const Eigen::Vector3d>(value(velocities_[i]));
      const Eigen::Map<const Eigen::Matrix<double, 6, 1>> bias(value(biases_[i]));
      state.bias = {bias.head<3>(), bias.tail<3>()};
    }
  }

 private:
  // Beyond this many sigmas of its nine coordinates together (95 % of them lie within) a link
  // counts less and less: readings that shake more than their noise model says must not bend the
  // map.
  static constexpr double kHuber = 4.1;

  const InertialTerms& terms_;
  std::vector<std::unique_ptr<ceres::CostFunction>> motions_, walks_, priors_;
  std::unique_ptr<ceres::CostFunction> gravity_prior_;
  GravityManifold gravity_manifold_;
  // Numbers of unknowns: one a state; gravity's is -1 before AddTo, and when there are no links.
  std::vector<int> velocities_, biases_;
  int gravity_ = -1;
};

}  // namespace airslam
