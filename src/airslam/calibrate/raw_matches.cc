// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/calibrate/raw_matches.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "airslam/common/error.h"
#include "airslam/common/options.h"

namespace airslam {
namespace {

struct View {
  cv::Mat image;
  Detections features;
};

struct PixelPair {
  int index = 0;  // of the first view's keypoint
  Eigen::Vector2d first, second;
};

class RawMatcher {
 public:
  RawMatcher(FeatureDetector& detector, FeatureMatcher& matcher, const RawMatchOptions& options)
      : detector_(detector), matcher_(matcher), options_(options) {}

  View Look(const cv::Mat& image) {
    return {image, detector_.Detect(image, cv::Mat(), options_.max_keypoints)};
  }

  std::vector<PixelPair> Match(const View& first, const View& second) {
    std::vector<PixelPair> pairs;
    for (const airslam::Match& match : matcher_.Match(
             {first.features.keypoints, first.features.descriptors, first.image.size()},
             {second.features.keypoints, second.features.descriptors, second.image.size()})) {
      const Keypoint& a = first.features.keypoints[static_cast<std::size_t>(match.index0)];
      const Keypoint& b = second.features.keypoints[static_cast<std::size_t>(match.index1)];
      const Eigen::Vector2d from(a.x, a.y);
      const PatchAlignment aligned =
          AlignPatch(first.image, from, Eigen::Matrix2d::Identity(), second.image,
                     Eigen::Vector2d(b.x, b.y), options_.alignment);
      if (aligned.converged) pairs.push_back({match.index0, from, aligned.pixel});
    }
    return pairs;
  }

 private:
  FeatureDetector& detector_;
  FeatureMatcher& matcher_;
  const RawMatchOptions& options_;
};

std::optional<StereoPair> TryRead(const Sequence& sequence, int index) {
  try {
    return sequence.Read(index);
  } catch (const Error&) {
    return std::nullopt;
  }
}

double Seconds(const Sequence& sequence, int from, int to) {
  return 1e-9 * static_cast<double>(sequence.timestamp_ns(to) - sequence.timestamp_ns(from));
}

// The first frame at least `span` seconds after `from`, the last one at the end; `from` itself when
// there is none within `max_span`.
int LaterFrame(const Sequence& sequence, int from, double span, double max_span) {
  int to = std::min(from + 1, sequence.size() - 1);
  while (to + 1 < sequence.size() && Seconds(sequence, from, to) < span) ++to;
  return Seconds(sequence, from, to) <= max_span ? to : from;
}

// How the left keypoints move until the frame `next`.
void AddVelocities(const Sequence& sequence, int frame, int next, const View& left,
                   const std::vector<int>& keypoints, RawMatcher& matcher,
                   std::span<RawMatch> matches) {
  const double step = Seconds(sequence, frame, next);
  const std::optional<StereoPair> pair = TryRead(sequence, next);
  if (!pair) return;
  std::vector<const PixelPair*> of_keypoint(left.features.keypoints.size(), nullptr);
  const std::vector<PixelPair> moved = matcher.Match(left, matcher.Look(pair->left));
  for (const PixelPair& m : moved) of_keypoint[static_cast<std::size_t>(m.index)] = &m;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    const PixelPair* m = of_keypoint[static_cast<std::size_t>(keypoints[i])];
    if (m == nullptr) continue;
    matches[i].has_velocity = true;
    matches[i].velocity = (m->second - m->first) / step;
  }
}

void AddMotion(const Sequence& sequence, int frame, const View& left,
               const RawMatchOptions& options, RawMatcher& matcher, RawMatches& result) {
  const int later = LaterFrame(sequence, frame, options.turn_span, options.max_turn_span);
  if (later == frame) return;
  const std::optional<StereoPair> pair = TryRead(sequence, later);
  if (!pair) return;
  RawMotion motion{sequence.timestamp_ns(frame), sequence.timestamp_ns(later), {}, {}};
  for (const PixelPair& m : matcher.Match(left, matcher.Look(pair->left))) {
    motion.from.push_back(m.first);
    motion.to.push_back(m.second);
  }
  result.motions.push_back(std::move(motion));
}

}  // namespace

void RawMatchOptions::Validate() const {
  RequireOption(frames >= 1 && frames <= 1000, "frames", frames, "must be 1 to 1000");
  RequireOption(max_keypoints >= 20 && max_keypoints <= 4096, "max_keypoints", max_keypoints,
                "must be 20 to 4096");
  RequireOption(max_step > 0, "max_step", max_step, "must be more than 0 s");
  RequireOption(turn_span > 0, "turn_span", turn_span, "must be more than 0 s");
  RequireOption(max_turn_span >= turn_span, "max_turn_span", max_turn_span,
                "must be at least turn_span");
}

RawMatches MatchRawImages(const Sequence& sequence, FeatureDetector& detector,
                          FeatureMatcher& feature_matcher, const RawMatchOptions& options,
                          int right_shift) {
  options.Validate();
  RawMatcher matcher(detector, feature_matcher, options);
  RawMatches result;
  // Frames whose shifted partner exists.
  const int first = std::max(0, -right_shift);
  const int last = sequence.size() - 1 - std::max(0, right_shift);
  const int count = std::min(options.frames, last - first + 1);
  for (int i = 0; i < count; ++i) {
    const int frame = first + (count > 1 ? i * (last - first) / (count - 1) : 0);
    const std::optional<StereoPair> pair = TryRead(sequence, frame);
    const std::optional<StereoPair> other =
        right_shift == 0 ? pair : TryRead(sequence, frame + right_shift);
    if (!pair || !other) {
      ++result.unreadable;
      continue;
    }
    const View left = matcher.Look(pair->left);
    const std::size_t begin = result.matches.size();
    std::vector<int> keypoints;
    for (const PixelPair& m : matcher.Match(left, matcher.Look(other->right))) {
      result.matches.push_back({frame, m.first, m.second});
      keypoints.push_back(m.index);
    }
    result.frames.push_back(frame);
    if (right_shift != 0) continue;
    const int next = LaterFrame(sequence, frame, 0, options.max_step);
    if (next != frame) {
      AddVelocities(sequence, frame, next, left, keypoints, matcher,
                    std::span(result.matches).subspan(begin));
    }
    AddMotion(sequence, frame, left, options, matcher, result);
  }
  return result;
}

}  // namespace airslam
