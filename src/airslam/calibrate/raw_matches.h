// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include <cstdint>
#include <vector>

#include "airslam/dataset/sequence.h"
#include "airslam/feature/patch_alignment.h"
#include "airslam/neural/feature_detector.h"
#include "airslam/neural/feature_matcher.h"

namespace airslam {

struct RawMatchOptions {
  int frames = 24;             // spread evenly over the sequence, 1..1000
  int max_keypoints = 400;     // of an image, 20..4096
  double max_step = 0.25;      // s: a later frame must follow within it to tell how pixels move
  double turn_span = 0.3;      // s between the two images whose turn is compared with the gyroscope
  double max_turn_span = 2.0;  // s: what is further apart is not compared
  // To sub-pixel accuracy; the shape of a patch is taken to be the same in both images.
  PatchAlignmentOptions alignment;

  // Throws Error that names the field.
  void Validate() const;
};

// A point that both cameras of a frame see, in pixels of the *raw* images, and how it moves in the
// left one. Nothing of the calibration is in it.
struct RawMatch {
  int frame = 0;  // of the sequence
  Eigen::Vector2d left = Eigen::Vector2d::Zero();
  Eigen::Vector2d right = Eigen::Vector2d::Zero();
  bool has_velocity = false;
  Eigen::Vector2d velocity = Eigen::Vector2d::Zero();  // of the left pixel, pixels per second
};

// Points that the left camera sees at two times, in raw pixels.
struct RawMotion {
  std::int64_t from_ns = 0, to_ns = 0;
  std::vector<Eigen::Vector2d> from, to;
};

struct RawMatches {
  std::vector<RawMatch> matches;
  std::vector<RawMotion> motions;
  std::vector<int> frames;  // that were matched, in order
  int unreadable = 0;       // frames whose images cannot be used
};

// Matches left and right images of frames spread over the sequence by their descriptors alone: rows
// are not assumed to correspond, so that the result says whether they do. Every match is aligned by
// its patch, which also drops most wrong ones.
//
// `right_shift`: frames by which the right image is taken later than the left one (0: as paired).
// Motions are left out when it is not 0. Throws Error for bad options.
RawMatches MatchRawImages(const Sequence& sequence, FeatureDetector& detector,
                          FeatureMatcher& matcher, const RawMatchOptions& options,
                          int right_shift = 0);

}  // namespace airslam
