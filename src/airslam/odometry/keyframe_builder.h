// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <span>
#include <vector>

#include "airslam/neural/feature_detector.h"
#include "airslam/odometry/frame_tracker.h"
#include "airslam/odometry/local_map.h"
#include "airslam/odometry/options.h"

namespace airslam {

// A keyframe that is not in the map yet.
struct KeyframeDraft {
  Keyframe keyframe;
  // Keypoints that look too different from their landmark's earlier patches: from this keyframe on
  // they define it.
  std::vector<int> redefining;
  ImagePyramid right_image;  // rectified; set by MatchRight
};

// Turns a tracked frame into a keyframe of the map: its keypoints take over the landmarks that were
// tracked or seen again, the right image gives depth, and what has depth but no landmark becomes a
// new one (paper, sections V-B and V-C).
class KeyframeBuilder {
 public:
  KeyframeBuilder(const OdometryOptions& options, const FrameTracker& tracker, LocalMap& map)
      : options_(options), tracker_(tracker), map_(map) {}

  // A keyframe at `tracked`, with the landmarks of the local map that it sees.
  KeyframeDraft FromTracked(const FrameView& frame, std::int64_t timestamp_ns,
                            const TrackedFrame& tracked) const;

  // The first keyframe of a component: no landmarks yet.
  KeyframeDraft FromDetections(const FrameView& frame, std::int64_t timestamp_ns, int component,
                               const Rigid3& world_from_cam) const;

  // Takes over the right image and fills draft.keyframe.right_x from it.
  void MatchRight(const FrameView& frame, ImagePyramid right_image, KeyframeDraft& draft) const;

  // Creates landmarks for keypoints with a right match and none yet. Returns their ids.
  std::vector<LandmarkId> AddStereoLandmarks(Keyframe& keyframe);

  // Creates landmarks for keypoints without a right match that the last keyframe sees too; it gets
  // the observations. Returns their ids.
  std::vector<LandmarkId> AddMotionLandmarks(const FrameView& frame, Keyframe& keyframe);

 private:
  struct Claim;
  KeypointGrid OccupiedPlaces(const Keyframe& keyframe) const;
  static int FreeKeypointAt(const FrameView& frame, const Keyframe& keyframe,
                            const Eigen::Vector2d& pixel);
  std::vector<Claim> ClaimLandmarks(const FrameView& frame, const TrackedFrame& tracked) const;

  const OdometryOptions& options_;
  const FrameTracker& tracker_;
  LocalMap& map_;
};

}  // namespace airslam
