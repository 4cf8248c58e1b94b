// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/loss_function.h>
#include <ceres/ordered_groups.h>
#include <ceres/problem.h>

#include <memory>
#include <vector>

#include "airslam/optimize/bias_walk_factor.h"
#include "airslam/optimize/inertial_factor.h"
#include "airslam/optimize/pose_parameter.h"
#include "airslam/optimize/pose_prior_factor.h"
#include "airslam/sensor/imu_preintegration.h"

namespace airslam {

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

// The factors of InertialTerms and the parameters that they move. The terms must outlive it.
class InertialBundle {
 public:
  // Throws Error when a link spans no time or a prior's covariance is not positive definite.
  explicit InertialBundle(const InertialTerms& terms);

  // Adds the factors, their squares times `weight`. `poses`: one a pose of the bundle. In the
  // elimination order they stay in group `group`; velocities, biases and gravity come into the
  // three groups after it. (Ceres orders the blocks of one group by address: those of one
  // allocation only may share a group, or runs would not repeat.)
  void AddTo(std::vector<PoseParameter>& poses, double weight, int group, ceres::Problem& problem,
             ceres::ParameterBlockOrdering& ordering);

  // Writes velocities, biases and gravity as they are now.
  void CopyTo(InertialTerms& terms) const;

 private:
  // Beyond this many sigmas of its nine coordinates together (95 % of them lie within) a link
  // counts less and less: readings that shake more than their noise model says must not bend the
  // map.
  static constexpr double kHuber = 4.1;

  const InertialTerms& terms_;
  std::vector<std::unique_ptr<ceres::CostFunction>> motions_, walks_, priors_;
  std::unique_ptr<ceres::CostFunction> gravity_prior_;
  std::vector<Eigen::Vector3d> velocities_;
  std::vector<BiasParameter> biases_;
  Eigen::Vector3d gravity_;
  std::unique_ptr<ceres::LossFunction> robust_, plain_;
};

}  // namespace airslam
