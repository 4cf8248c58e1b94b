// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace airslam {

// Lines of keyframes (paper, sections V-B, V-C and V-E). Frames between keyframes have none: a
// frame's pose comes from points.
struct LineOptions {
  bool enabled = true;
  double min_score = 0.4;
  double min_length = 20.0;
  double min_match_score = 0.3;
  int min_shared_points = 1;
  double pixel_sigma = 0.2;
  double max_end_error = 4.0;
  double max_length = 30.0;
  double max_depth = 40.0;
  double max_depth_error = 0.1;
  int patience = 3;

  template <class V>
  void Visit(V& v) {
    v.Field("enabled", enabled, "False, or a model pack without a line module: points alone.");
    v.Field("min_score", min_score, {0, 1},
            "The network's probability that a line is one: less probable ones are left out.");
    v.Field("min_length", min_length, {1, 10000, "px"},
            "Shorter lines are kept as detected but not triangulated.");
    v.Field("min_match_score", min_match_score, {0, 1},
            "delta_S: two lines match when they share a greater share of their points than this.");
    v.Field("min_shared_points", min_shared_points, {0, 1000},
            "delta_N: two lines match when they share more points than this.");
    v.Field(
        "pixel_sigma", pixel_sigma, {0.01, 100, "px"},
        "Standard deviation of an end point across its line, which lies on an edge of the image: "
        "half of a point's `tracking.pixel_sigma`.");
    v.Field(
        "max_end_error", max_end_error, {0.1, 1000, "px"},
        "A line of the map whose image misses the ends of a matched line by more is another one.");
    v.Field("max_length", max_length, {0.1, 10000, "m"},
            "Longer lines come from planes that are nearly parallel.");
    v.Field("max_depth", max_depth, {0.2, 10000, "m"},
            "Lines that are farther away come from planes that are nearly parallel, too.");
    v.Field("max_depth_error", max_depth_error, {0.001, 100},
            "Standard deviation of the depth of a line's ends as a share of the depth: a line with "
            "more is forgotten after `patience` keyframes.");
    v.Field("patience", patience, {1, 100000},
            "Keyframes after which a line that is uncertain in depth, or that only one keyframe "
            "has seen, is forgotten.");
  }
};

}  // namespace airslam
