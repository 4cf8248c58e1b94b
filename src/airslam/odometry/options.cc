// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/options.h"

#include "airslam/common/error.h"

namespace airslam {
namespace {

template <typename T>
void RequireRange(const char* field, T value, T low, T high) {
  if (!(value >= low && value <= high)) {
    Fail("option {} is {}, which is not in the range {} to {}", field, value, low, high);
  }
}

}  // namespace

void OdometryOptions::Validate() const {
  RequireRange("max_keypoints", max_keypoints, 50, 2000);
  RequireRange("tracking.search_radius", tracking.search_radius, 0.001, 1.0);
  RequireRange("tracking.min_similarity", tracking.min_similarity, -1.0, 1.0);
  RequireRange("tracking.ransac_error", tracking.ransac_error, 0.1, 100.0);
  RequireRange("tracking.min_convincing", tracking.min_convincing, 1, 2000);
  RequireRange("tracking.min_found_share", tracking.min_found_share, 0.0, 1.0);
  RequireRange("tracking.min_tracked", tracking.min_tracked, 6, 2000);
  RequireRange("tracking.coarse_below", tracking.coarse_below, 0, 2000);
  RequireRange("tracking.pixel_sigma", tracking.pixel_sigma, 0.01, 10.0);
  RequireRange("tracking.min_correlation", tracking.min_correlation, 0.01, 0.99);
  RequireRange("keyframe.min_tracked_share", keyframe.min_tracked_share, 0.01, 0.99);
  RequireRange("keyframe.max_parallax", keyframe.max_parallax, 0.001, 10.0);
  RequireRange("keyframe.min_tracked", keyframe.min_tracked, 1, 2000);
  RequireRange("keyframe.min_spacing", keyframe.min_spacing, 0.0, 100.0);
  RequireRange("local_map.window", local_map.window, 2, 100);
  RequireRange("local_map.max_fixed", local_map.max_fixed, 1, 1000);
  RequireRange("local_map.lag_frames", local_map.lag_frames, 1, 100);
  RequireRange("local_map.iterations", local_map.iterations, 1, 100);
  RequireRange("recovery.keyframes", recovery.keyframes, 1, 100);
  RequireRange("recovery.min_inliers", recovery.min_inliers, 6, 2000);
  RequireRange("recovery.min_found_share", recovery.min_found_share, 0.0, 1.0);
  RequireRange("recovery.lost_frames", recovery.lost_frames, 1, 100000);
  RequireRange("recovery.min_stereo_points", recovery.min_stereo_points, 6, 2000);
  RequireRange("inertial.max_gap", inertial.max_gap, 0.001, 10.0);
  RequireRange("inertial.max_angular_velocity", inertial.max_angular_velocity, 0.1, 1e6);
  RequireRange("inertial.max_acceleration", inertial.max_acceleration, 1.0, 1e6);
  RequireRange("inertial.max_blackout", inertial.max_blackout, 0.0, 60.0);
  RequireRange("inertial.max_position_sigma", inertial.max_position_sigma, 0.001, 1000.0);
  RequireRange("lines.min_score", lines.min_score, 0.0, 1.0);
  RequireRange("lines.min_length", lines.min_length, 1.0, 10000.0);
  RequireRange("lines.min_match_score", lines.min_match_score, 0.0, 1.0);
  RequireRange("lines.min_shared_points", lines.min_shared_points, 0, 1000);
  RequireRange("lines.pixel_sigma", lines.pixel_sigma, 0.01, 100.0);
  RequireRange("lines.max_end_error", lines.max_end_error, 0.1, 1000.0);
  RequireRange("lines.max_length", lines.max_length, 0.1, 10000.0);
  RequireRange("lines.max_depth", lines.max_depth, 0.2, 10000.0);
  RequireRange("lines.max_depth_error", lines.max_depth_error, 0.001, 100.0);
  RequireRange("lines.patience", lines.patience, 1, 100000);
}

}  // namespace airslam
