// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/refine/map_inertia.h"

#include <cmath>

namespace airslam {
namespace {

constexpr double kGravity = 9.81;  // m/s^2
constexpr double kMaxTilt = 0.05;  // rad, between the gravities of components
// The states know gravity and biases already; these priors only hold what the readings leave open.
constexpr double kGravitySigma = 0.02;           // rad
constexpr double kGyroscopeBiasSigma = 0.005;    // rad/s
constexpr double kAccelerometerBiasSigma = 0.1;  // m/s^2

// One component's states and links, with their own numbering.
struct ComponentTerms {
  std::vector<InertialTerms::State> states;
  std::vector<InertialTerms::Link> links;
  const Keyframe* previous = nullptr;  // the last keyframe, when it has a state
  Eigen::Vector3d weighted_gravity = Eigen::Vector3d::Zero();  // sum of T (v_j - v_i - R_i dv)
  double weight = 0;                                           // sum of T^2

  Eigen::Vector3d gravity() const { return weighted_gravity / weight; }
};

// Readings belong to the two keyframes only if no keyframe was removed between them.
bool AreLinked(const Keyframe* previous, const Keyframe& keyframe) {
  return previous != nullptr && keyframe.imu_samples.size() >= 2 &&
         keyframe.imu_samples.front().timestamp_ns == previous->timestamp_ns &&
         keyframe.imu_samples.back().timestamp_ns == keyframe.timestamp_ns;
}

void AddKeyframe(const Keyframe& keyframe, int position, const Rigid3& body_from_cam,
                 ComponentTerms& terms) {
  if (!keyframe.has_inertial_state) {
    terms.previous = nullptr;
    return;
  }
  const int state = static_cast<int>(terms.states.size());
  terms.states.push_back({position,
                          keyframe.velocity_in_world,
                          {keyframe.gyroscope_bias, keyframe.accelerometer_bias}});
  if (AreLinked(terms.previous, keyframe)) {
    const Keyframe& from = *terms.previous;
    auto readings = std::make_shared<ImuPreintegration>(keyframe.imu_samples, keyframe.imu_noise,
                                                        terms.states[state - 1].bias);
    const Eigen::Quaterniond world_from_body =
        from.world_from_cam.rotation * body_from_cam.rotation.conjugate();
    const double duration = readings->duration();
    terms.weighted_gravity += duration * (keyframe.velocity_in_world - from.velocity_in_world -
                                          world_from_body * readings->delta().velocity);
    terms.weight += duration * duration;
    terms.links.push_back({state - 1, state, std::move(readings)});
  }
  terms.previous = &keyframe;
}

// Each chain of links begins with a prior of its biases.
void AddPriors(InertialTerms& terms) {
  for (std::size_t i = 0; i < terms.links.size(); ++i) {
    const int from = terms.links[i].from;
    if (i > 0 && terms.links[i - 1].to == from) continue;
    Matrix6d covariance = Matrix6d::Zero();
    covariance.diagonal().head<3>().setConstant(kGyroscopeBiasSigma * kGyroscopeBiasSigma);
    covariance.diagonal().tail<3>().setConstant(kAccelerometerBiasSigma * kAccelerometerBiasSigma);
    terms.priors.push_back({from, terms.states[from].bias, covariance});
  }
}

}  // namespace

InertialTerms CollectInertialTerms(const Map& map, const std::map<KeyframeId, int>& positions) {
  std::map<int, ComponentTerms> components;
  const Rigid3& body_from_cam = map.calibration.body_from_left;
  for (const auto& [id, keyframe] : map.keyframes) {
    AddKeyframe(keyframe, positions.at(id), body_from_cam, components[keyframe.component]);
  }
  const ComponentTerms* largest = nullptr;
  for (const auto& [component, terms] : components) {
    if (terms.links.empty()) continue;
    if (largest == nullptr || terms.links.size() > largest->links.size()) largest = &terms;
  }
  InertialTerms all;
  if (largest == nullptr) return all;
  all.gravity_in_world = kGravity * largest->gravity().normalized();
  all.gravity_sigma = kGravitySigma;
  all.body_from_cam = body_from_cam;
  for (const auto& [component, terms] : components) {
    if (terms.links.empty()) continue;
    if (terms.gravity().normalized().dot(all.gravity_in_world / kGravity) < std::cos(kMaxTilt)) {
      continue;
    }
    const int offset = static_cast<int>(all.states.size());
    all.states.insert(all.states.end(), terms.states.begin(), terms.states.end());
    for (const InertialTerms::Link& link : terms.links) {
      all.links.push_back({link.from + offset, link.to + offset, link.readings});
    }
  }
  AddPriors(all);
  return all;
}

void ApplyInertialTerms(const InertialTerms& terms, const std::vector<KeyframeId>& keyframes,
                        Map& map) {
  for (const InertialTerms::State& state : terms.states) {
    Keyframe& keyframe = map.keyframes.at(keyframes[state.pose]);
    keyframe.velocity_in_world = state.velocity_in_world;
    keyframe.gyroscope_bias = state.bias.gyroscope;
    keyframe.accelerometer_bias = state.bias.accelerometer;
  }
}

}  // namespace airslam
