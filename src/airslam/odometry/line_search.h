// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <future>
#include <optional>
#include <vector>

#include "airslam/common/stage_times.h"
#include "airslam/feature/image_pyramid.h"
#include "airslam/map/keyframe.h"
#include "airslam/neural/feature_detector.h"
#include "airslam/odometry/line_options.h"
#include "airslam/sensor/rectification.h"

namespace airslam {

// A keyframe's images, in which lines are to be found.
struct LineSearchImages {
  KeyframeId keyframe = -1;
  ImagePyramid left, right;  // rectified
  Detections seen;           // in the left image, with maps
};

// The lines of a keyframe.
struct KeyframeLines {
  KeyframeId keyframe = -1;
  Detections left;                 // lines on their edges (RefineLine), junctions as detected
  std::vector<LineSegment> right;  // one a left line, kNoLine where it is not found
};

// Finds the lines of one keyframe at a time on a thread of its own: what takes longest of a
// keyframe, and the frames after it need points only. The owner decides when it takes them, by
// keyframe and never by the clock, so that every run repeats.
class LineSearch {
 public:
  // `detector` is used by this search alone. All must outlive it.
  LineSearch(FeatureDetector& detector, const StereoRectifier& rectifier,
             const LineOptions& options, StageTimes& times)
      : detector_(detector), rectifier_(rectifier), options_(options), times_(times) {}

  // At most one search may be under way.
  void Begin(LineSearchImages images);
  // Waits for the search that is under way; nothing without one. Rethrows what searching threw.
  std::optional<KeyframeLines> Take();

 private:
  KeyframeLines Find(const LineSearchImages& images);

  FeatureDetector& detector_;
  const StereoRectifier& rectifier_;
  const LineOptions& options_;
  StageTimes& times_;
  std::future<KeyframeLines> under_way_;  // ends before what it uses
};

}  // namespace airslam
