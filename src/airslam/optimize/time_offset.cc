// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/time_offset.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "airslam/geometry/so3.h"
#include "airslam/sensor/imu_preintegration.h"

namespace airslam {
namespace {

using Eigen::Vector3d;

// Sum of squares of the turns' errors (rad) at one shift, with the best bias for it.
double TurnCost(const std::vector<InertialFrame>& frames, const ImuBuffer& imu,
                const Vector3d& bias, const Rigid3& body_from_cam, std::int64_t shift_ns) {
  double squares = 0, time_square = 0;
  Vector3d time_error = Vector3d::Zero();
  for (std::size_t i = 0; i + 1 < frames.size(); ++i) {
    const std::int64_t begin = frames[i].timestamp_ns, end = frames[i + 1].timestamp_ns;
    const Eigen::Quaterniond seen =
        body_from_cam.rotation * frames[i].world_from_cam.rotation.conjugate() *
        frames[i + 1].world_from_cam.rotation * body_from_cam.rotation.conjugate();
    const Vector3d error = LogSO3(
        GyroscopeTurn(imu.Between(begin + shift_ns, end + shift_ns).samples, bias).conjugate() *
        seen);
    const double t = 1e-9 * static_cast<double>(end - begin);
    squares += error.squaredNorm();
    time_error += t * error;
    time_square += t * t;
  }
  return squares - time_error.squaredNorm() / time_square;
}

}  // namespace

TimeOffsetEstimate EstimateTimeOffset(const InertialInitializationOptions& options,
                                      const std::vector<InertialFrame>& frames,
                                      const ImuBuffer& imu, const Eigen::Vector3d& gyroscope_bias,
                                      const Rigid3& body_from_cam) {
  if (frames.size() < 4) return {};
  const double step = options.time_offset_step;
  const int half = static_cast<int>(options.time_offset_search / step + 0.5);
  std::vector<double> costs;
  for (int k = -half; k <= half; ++k) {
    costs.push_back(
        TurnCost(frames, imu, gyroscope_bias, body_from_cam, std::llround(1e9 * step * k)));
  }
  const int best = static_cast<int>(std::min_element(costs.begin(), costs.end()) - costs.begin());
  TimeOffsetEstimate estimate;
  estimate.offset = step * (best - half);
  if (best == 0 || best == 2 * half) return estimate;
  // A parabola through the minimum and its neighbours.
  const double curvature = (costs[best - 1] - 2 * costs[best] + costs[best + 1]) / (step * step);
  if (!(curvature > 0)) return estimate;
  estimate.offset += -(costs[best + 1] - costs[best - 1]) / (2 * step * curvature);
  // The errors' variance as it is found; less the biases and the offset in freedom.
  const double freedom = 3.0 * static_cast<double>(frames.size() - 1) - 4;
  const double variance = std::max(costs[best] / freedom, 1e-10);
  estimate.sigma = std::sqrt(2 * variance / curvature);
  return estimate;
}

}  // namespace airslam
