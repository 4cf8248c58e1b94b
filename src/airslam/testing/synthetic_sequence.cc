// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/testing/synthetic_sequence.h"

namespace airslam {

SyntheticSequence::SyntheticSequence(const SyntheticSequenceOptions& options)
    : options_(options),
      world_(options.world),
      left_(world_, options_.rig.left.camera),
      right_(world_, options_.rig.right.camera) {
  options_.rig.rate_hz = options_.rate_hz;
  options_.trajectory.Mount(HeadingFromBody(options_.rig), options_.start_ns);
  states_ = options_.trajectory.Sample(options_.rate_hz, options_.frames);
  if (!options_.rig.imu || states_.empty()) return;
  ImuSimulationOptions simulation = options_.imu;
  if (simulation.noise.rate_hz <= 0) simulation.noise = *options_.rig.imu;
  if (!options_.imu_noise) {
    const double rate_hz = simulation.noise.rate_hz;
    simulation.noise = ImuNoise();
    simulation.noise.rate_hz = rate_hz;
  }
  imu_ =
      SimulateImu(options_.trajectory, options_.start_ns, states_.back().timestamp_ns, simulation);
}

StereoPair SyntheticSequence::Read(int index) const {
  const BodyState& state = states_.at(static_cast<std::size_t>(index));
  Illumination light = options_.light(index);
  const auto render = [&](const ImageRenderer& renderer, const RigCamera& camera) {
    light.noise_seed = light.noise_seed * 2654435761u + 1;
    return renderer.Render(state.world_from_body * camera.body_from_cam, light).image;
  };
  StereoPair pair;
  pair.timestamp_ns = state.timestamp_ns;
  pair.left = render(left_, options_.rig.left);
  pair.right = render(right_, options_.rig.right);
  return pair;
}

Trajectory SyntheticSequence::ground_truth() const {
  Trajectory trajectory;
  for (const BodyState& state : states_) {
    trajectory.push_back({state.timestamp_ns, state.world_from_body});
  }
  return trajectory;
}

}  // namespace airslam
