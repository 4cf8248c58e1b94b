// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "airslam/feature/line_matching.h"
#include "airslam/feature/point_line_association.h"
#include "airslam/geometry/line_triangulation.h"
#include "airslam/neural/detections.h"
#include "airslam/odometry/line_options.h"
#include "airslam/odometry/line_search.h"
#include "airslam/odometry/local_map.h"

namespace airslam {

// What a keyframe's lines changed in the map.
struct LineChanges {
  KeyframeId keyframe = -1;
  std::vector<LandmarkId> added;     // line landmarks
  std::vector<KeyframeId> observed;  // earlier keyframes that turned out to see one of them
};

// Gives a keyframe its lines: matched with those of earlier keyframes by the points that they share
// (paper, section V-B), or found where the map's lines should be seen, and triangulated from two
// planes or two points (section V-C).
class LineBuilder {
 public:
  LineBuilder(const LineOptions& options, LocalMap& map) : options_(options), map_(map) {}

  // Gives its lines and junctions to the latest keyframe of the map, and finds the lines'
  // landmarks: those that the window's other keyframes see, and new ones.
  LineChanges AddLines(KeyframeLines found);

 private:
  LineChanges FindLandmarks(Keyframe& keyframe);
  // Lines of earlier keyframes that show the same as a line of the new one, the latest first.
  using Tracks = std::vector<std::vector<FeatureRef>>;
  Tracks FollowLines(const Keyframe& keyframe) const;
  bool Shows(const Keyframe& keyframe, int line, const LineLandmark& landmark) const;
  void Inherit(const Tracks& tracks, Keyframe& keyframe) const;
  void SeekLandmarks(Keyframe& keyframe) const;
  std::vector<LinePoint> PointsOf(const Keyframe& keyframe, const std::vector<int>& indices) const;
  void AddSightings(const Keyframe& keyframe, int line, std::vector<LineSighting>& sightings) const;
  LineMatchingOptions MatchingOptions() const;
  LineTriangulationOptions TriangulationOptions() const;

  const LineOptions& options_;
  LocalMap& map_;
};

}  // namespace airslam
