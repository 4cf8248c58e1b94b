// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "airslam/feature/line_matching.h"
#include "airslam/feature/point_line_association.h"
#include "airslam/geometry/line_triangulation.h"
#include "airslam/neural/detections.h"
#include "airslam/odometry/line_options.h"
#include "airslam/odometry/local_map.h"

namespace airslam {

// What a new keyframe's lines changed in the map.
struct LineChanges {
  std::vector<LandmarkId> added;     // line landmarks
  std::vector<KeyframeId> observed;  // earlier keyframes that turned out to see one of them
};

// Gives a keyframe its lines: matched with the right image's and with those of earlier keyframes by
// the points that they share (paper, section V-B), or found where the map's lines should be seen,
// and triangulated from two planes or two points (section V-C).
class LineBuilder {
 public:
  LineBuilder(const LineOptions& options, LocalMap& map) : options_(options), map_(map) {}

  // Takes over the lines and junctions of the left image and matches the lines with those of the
  // right one. keyframe.keypoints and right_x must be set.
  void SetLines(const Detections& left, const Detections& right, Keyframe& keyframe) const;

  // Finds the landmarks of the lines of a keyframe that is not in the map yet but has the landmarks
  // of its points: those that the window's keyframes see, and new ones.
  LineChanges FindLandmarks(Keyframe& keyframe);

 private:
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
