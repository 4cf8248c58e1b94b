// SPDX-License-Identifier: BSD-3-Clause
//
// A small finished map of the synthetic world, made without odometry: exact poses, exact landmarks.
#pragma once

#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

#include "airslam/map/map.h"
#include "airslam/place/place_index.h"
#include "airslam/sensor/rectification.h"
#include "airslam/testing/synthetic_detector.h"
#include "airslam/testing/synthetic_sequence.h"

namespace airslam {

// Finds lines as well: its strongest keypoints are junctions, each joined to the next.
class SyntheticLineDetector : public SyntheticDetector {
 public:
  Detections Detect(const cv::Mat& image, const cv::Mat& mask,
                    const DetectionRequest& request) override {
    Detections found = SyntheticDetector::Detect(image, mask, request);
    if (!request.lines) return found;
    const std::size_t count = std::min<std::size_t>(40, found.keypoints.size());
    found.junctions.assign(found.keypoints.begin(),
                           found.keypoints.begin() + static_cast<std::ptrdiff_t>(count));
    found.junction_descriptors = found.descriptors.topRows(static_cast<Eigen::Index>(count));
    for (std::size_t i = 1; i < count; ++i) {
      const Keypoint &a = found.junctions[i - 1], &b = found.junctions[i];
      found.lines.push_back({a.x, a.y, b.x, b.y, 1});
    }
    return found;
  }
  bool finds_lines() const override { return true; }
};

// The hall seen on a loop through it, every `step`-th frame a keyframe.
class SyntheticPlace {
 public:
  explicit SyntheticPlace(int frames = 40, int step = 4) : sequence_(Options(frames)) {
    map_.calibration = {rectifier_.stereo(), rectifier_.body_from_left(), true};
    map_.model_pack = "synthetic";
    map_.model_pack_sha256 = "synthetic";
    for (int i = 0; i < frames; i += step) AddKeyframe(i);
  }

  const SyntheticSequence& sequence() const { return sequence_; }
  const Map& map() const { return map_; }
  Map& map() { return map_; }
  const Pinhole& camera() const { return rectifier_.stereo().camera; }

  // The left camera at a frame, and what it shows there.
  Rigid3 WorldFromCam(int frame) const {
    return sequence_.states()[static_cast<std::size_t>(frame)].world_from_body *
           rectifier_.body_from_left();
  }
  cv::Mat Image(int frame) const { return rectifier_.RectifyLeft(sequence_.Read(frame).left); }

  std::shared_ptr<const Vocabulary> TrainKeypointVocabulary() const {
    std::vector<DescriptorMatrix> images;
    for (const auto& [id, keyframe] : map_.keyframes) images.push_back(keyframe.descriptors);
    return std::make_shared<Vocabulary>(
        TrainVocabulary(images, map_.model_pack_sha256, {.branching = 8, .levels = 3}));
  }

  PlaceIndex MakeIndex() const {
    return PlaceIndex(map_, TrainKeypointVocabulary(), TrainJunctionVocabulary(map_));
  }

 private:
  static SyntheticSequenceOptions Options(int frames) {
    SyntheticSequenceOptions options;
    options.rig = IdealRig(320, 208);
    options.frames = frames;
    return options;
  }

  void AddKeyframe(int frame) {
    const Detections found = SyntheticLineDetector().Detect(Image(frame), {}, {300, true});
    Keyframe keyframe;
    keyframe.id = static_cast<KeyframeId>(map_.keyframes.size());
    keyframe.timestamp_ns = sequence_.timestamp_ns(frame);
    keyframe.world_from_cam = WorldFromCam(frame);
    keyframe.keypoints = found.keypoints;
    keyframe.descriptors = found.descriptors;
    keyframe.right_x.assign(found.keypoints.size(), -1.0F);
    keyframe.lines = found.lines;
    keyframe.right_lines.assign(found.lines.size(), LineSegment{0, 0, 0, 0, -1});
    keyframe.line_landmarks.assign(found.lines.size(), kNoLandmark);
    keyframe.junctions = found.junctions;
    keyframe.junction_descriptors = found.junction_descriptors;
    for (const Keypoint& k : found.keypoints) {
      const Eigen::Vector3d ray = keyframe.world_from_cam.rotation * camera().Unproject({k.x, k.y});
      const Eigen::Vector3d eye = keyframe.world_from_cam.translation;
      const auto hit = sequence_.world().Cast(eye, ray);
      const auto id = static_cast<LandmarkId>(map_.landmarks.size());
      map_.landmarks[id] = {id, eye + hit->distance * ray, keyframe.id};
      keyframe.landmarks.push_back(id);
    }
    map_.keyframes[keyframe.id] = std::move(keyframe);
  }

  SyntheticSequence sequence_;
  StereoRectifier rectifier_{sequence_.rig()};
  Map map_;
};

}  // namespace airslam
