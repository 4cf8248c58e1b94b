// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace airslam {

// Lines of keyframes (paper, sections V-B to V-D). Frames between keyframes have none: a frame's
// pose comes from points.
struct LineOptions {
  // False, or a model pack without a line module: points alone.
  bool enabled = true;
  // The network's probability that a line is one, in [0, 1]: less probable ones are left out.
  double min_score = 0.4;
  // Pixels: shorter lines are kept as detected but not triangulated, > 0.
  double min_length = 20.0;
  // delta_S and delta_N (feature/line_matching.h): two lines match when they share a greater share
  // of their points than this, in [0, 1],
  double min_match_score = 0.3;
  // and more points than this, >= 0.
  int min_shared_points = 1;
  // Standard deviation of an end point across its line in pixels, > 0. More than the 0.3 to 0.4 that
  // one end misses its line by: with 0.5 lines outweighed better points (docs/odometry.md).
  double pixel_sigma = 1.0;
  // Pixels, > 0: a line of the map whose image misses the ends of a matched line by more is another
  // one.
  double max_end_error = 4.0;
  // Metres, > 0: longer or farther lines come from planes that are nearly parallel.
  double max_length = 30.0;
  double max_depth = 40.0;
  // Standard deviation of the depth of a line's ends as a share of the depth, > 0: a line with more
  // is forgotten
  double max_depth_error = 0.1;
  // when this many keyframes have been made since it was first seen, >= 1; so is one that only one
  // keyframe has seen.
  int patience = 3;

  template <class V>
  void Visit(V& v) {
    v.Field("enabled", enabled);
    v.Field("min_score", min_score);
    v.Field("min_length", min_length);
    v.Field("min_match_score", min_match_score);
    v.Field("min_shared_points", min_shared_points);
    v.Field("pixel_sigma", pixel_sigma);
    v.Field("max_end_error", max_end_error);
    v.Field("max_length", max_length);
    v.Field("max_depth", max_depth);
    v.Field("max_depth_error", max_depth_error);
    v.Field("patience", patience);
  }
};

}  // namespace airslam
