// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <optional>
#include <set>
#include <span>
#include <vector>

#include "airslam/geometry/line_triangulation.h"
#include "airslam/map/map.h"
#include "airslam/map/map_file.h"
#include "airslam/odometry/bundle_job.h"
#include "airslam/odometry/line_options.h"

namespace airslam {

// What a keyframe's line shows: in its left image and, where it was matched, in its right one.
LineObservation ObservationOf(const Keyframe& keyframe, int line, double pixel_sigma);

// The stretch of an endless line, world, that these sightings have seen: from the outermost of
// their ends to the other. Nothing when none of them sees the line before its camera.
std::optional<SpaceSegment> ObservedStretch(const PluckerLine& line_in_world,
                                            std::span<const LineSighting> sightings);

// The line landmarks of a growing map: who sees which, their part in bundle adjustments, and which
// of them are forgotten. A part of LocalMap.
class LocalLines {
 public:
  // `map` must outlive it.
  LocalLines(const LineOptions& options, Map& map) : options_(options), map_(map) {}

  // `ends_in_world` must differ. `first` is the keyframe that saw it first.
  LandmarkId Add(const SpaceSegment& ends_in_world, KeyframeId first);
  // Line `ref.index` of a keyframe of the map sees a landmark that was added after it.
  void AddObservation(LandmarkId id, const FeatureRef& ref);
  // A keyframe that is part of the map from now on.
  void AddKeyframe(const Keyframe& keyframe);
  // Oldest first.
  const std::vector<FeatureRef>& observations(LandmarkId id) const { return seen_by_.at(id); }

  // Adds the lines that the window sees to a job with `pose_of` its keyframes.
  void AddTo(std::span<const KeyframeId> window, const std::map<KeyframeId, int>& pose_of,
             BundleJob& job) const;
  // Takes over the lines of a solved job, whose poses the map has already. `new_from_old`: how each
  // of its keyframes moved, in world.
  void Apply(const BundleJob& solved, const std::map<KeyframeId, Rigid3>& new_from_old,
             MapWriter::Update& update);
  // At the end no more keyframes will come: forgets the lines that were still waiting for some.
  void Settle(MapWriter::Update& update);

 private:
  void RemoveObservation(const FeatureRef& ref);
  bool Place(const PluckerLine& line_in_world, LandmarkId id);
  bool IsPlausible(const LineLandmark& landmark) const;
  double DepthError(const LineLandmark& landmark) const;
  bool IsKnown(const LineLandmark& landmark) const;
  bool IsWorthKeeping(const LineLandmark& landmark) const;
  void Forget(LandmarkId id, std::set<KeyframeId>& changed, MapWriter::Update& update);
  void ReportChanged(const std::set<KeyframeId>& changed, MapWriter::Update& update) const;

  const LineOptions options_;
  Map& map_;
  std::map<LandmarkId, std::vector<FeatureRef>> seen_by_;
  LandmarkId next_ = 0;
};

}  // namespace airslam
