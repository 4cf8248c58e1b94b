// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/line_builder.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

namespace airslam {
namespace {

PointLineAssociation Associate(const Keyframe& keyframe) {
  constexpr double kMaxOvershoot = 10;  // pixels; see PointLineOptions
  return AssociatePoints(keyframe.keypoints, keyframe.lines, {.max_overshoot = kMaxOvershoot});
}

// The image of the stretch of a landmark, without the image's border; nothing when an end lies
// behind the camera.
std::optional<ImageSegment> ImageOf(const Pinhole& camera, const Rigid3& cam_from_world,
                                    const LineLandmark& landmark) {
  constexpr double kMinDepth = 0.05;  // metres
  const Eigen::Vector3d start = cam_from_world * landmark.ends_in_world.start;
  const Eigen::Vector3d end = cam_from_world * landmark.ends_in_world.end;
  if (start.z() < kMinDepth || end.z() < kMinDepth) return std::nullopt;
  return ImageSegment{camera.Project(start), camera.Project(end)};
}

// Pixels by which the ends of a seen segment miss the endless line through another, expected one;
// infinite when they are not side by side for half of the seen one's length.
double Misfit(const ImageSegment& seen, const ImageSegment& expected) {
  constexpr double kMinBeside = 0.5;
  constexpr double kNone = std::numeric_limits<double>::infinity();
  const auto line = ImageLine::Through(expected);
  if (!line) return kNone;
  const Eigen::Vector2d along = (expected.end - expected.start).normalized();
  const double a = along.dot(seen.start - expected.start);
  const double b = along.dot(seen.end - expected.start);
  const double beside = std::min(std::max(a, b), expected.Length()) - std::max(std::min(a, b), 0.0);
  if (beside < kMinBeside * seen.Length()) return kNone;
  return std::max(line->Distance(seen.start), line->Distance(seen.end));
}

// Keypoints of two keyframes that see the same landmark.
std::vector<Match> SharedPoints(const Keyframe& a, const Keyframe& b) {
  std::map<LandmarkId, int> place;
  for (std::size_t i = 0; i < b.landmarks.size(); ++i) {
    if (b.landmarks[i] != kNoLandmark) place[b.landmarks[i]] = static_cast<int>(i);
  }
  std::vector<Match> matches;
  for (std::size_t i = 0; i < a.landmarks.size(); ++i) {
    const auto found = place.find(a.landmarks[i]);
    if (found != place.end()) matches.push_back({static_cast<int>(i), found->second, 1});
  }
  return matches;
}

}  // namespace

LineMatchingOptions LineBuilder::MatchingOptions() const {
  return {options_.min_match_score, options_.min_shared_points};
}

LineTriangulationOptions LineBuilder::TriangulationOptions() const {
  LineTriangulationOptions options;
  options.min_segment = options_.min_length;
  options.max_depth = options_.max_depth;
  options.pixel_sigma = options_.pixel_sigma;
  return options;
}

LineChanges LineBuilder::AddLines(KeyframeLines found) {
  Keyframe& keyframe = map_.map().keyframes.at(found.keyframe);
  keyframe.lines = std::move(found.left.lines);
  keyframe.right_lines = std::move(found.right);
  keyframe.junctions = std::move(found.left.junctions);
  keyframe.junction_descriptors = std::move(found.left.junction_descriptors);
  keyframe.line_landmarks.assign(keyframe.lines.size(), kNoLandmark);
  LineChanges changes = FindLandmarks(keyframe);
  map_.lines().AddKeyframe(keyframe);
  return changes;
}

LineBuilder::Tracks LineBuilder::FollowLines(const Keyframe& keyframe) const {
  Tracks tracks(keyframe.lines.size());
  const PointLineAssociation here = Associate(keyframe);
  const std::span<const KeyframeId> window = map_.window();
  for (auto id = window.rbegin(); id != window.rend(); ++id) {
    const Keyframe& earlier = map_.map().keyframes.at(*id);
    if (earlier.id == keyframe.id || earlier.lines.empty()) continue;
    const std::vector<Match> points = SharedPoints(keyframe, earlier);
    for (const Match& match : MatchLines(here, Associate(earlier), points, MatchingOptions())) {
      tracks[match.index0].push_back({earlier.id, match.index1});
    }
  }
  return tracks;
}

// Whether a line of the map lies where a keyframe's line was seen.
bool LineBuilder::Shows(const Keyframe& keyframe, int line, const LineLandmark& landmark) const {
  const StereoCamera& stereo = map_.stereo();
  const PluckerLine in_left = keyframe.world_from_cam.Inverse() * landmark.line_in_world();
  const LineObservation seen = ObservationOf(keyframe, line, options_.pixel_sigma);
  const auto fits = [&](const PluckerLine& line_in_cam, const ImageSegment& segment) {
    return EndPointError(stereo.camera, line_in_cam, segment) <= options_.max_end_error &&
           SegmentSeenAt(stereo.camera, line_in_cam, segment).has_value();
  };
  return fits(in_left, seen.left) &&
         (!seen.right || fits(RightFromLeft(stereo) * in_left, *seen.right));
}

// Lines take over the landmarks of the lines that they follow, the latest first.
void LineBuilder::Inherit(const Tracks& tracks, Keyframe& keyframe) const {
  std::set<LandmarkId> taken;
  for (std::size_t i = 0; i < tracks.size(); ++i) {
    for (const FeatureRef& ref : tracks[i]) {
      const LandmarkId id = map_.map().keyframes.at(ref.keyframe).line_landmarks[ref.index];
      if (id == kNoLandmark || taken.contains(id)) continue;
      if (!Shows(keyframe, static_cast<int>(i), map_.map().line_landmarks.at(id))) continue;
      keyframe.line_landmarks[i] = id;
      taken.insert(id);
      break;
    }
  }
}

// Lines that share too few points with earlier ones may still show a line of the map: one that the
// window sees, whose image lies where the line is, and no other line lies there nearly as well.
void LineBuilder::SeekLandmarks(Keyframe& keyframe) const {
  std::set<LandmarkId> wanted;
  for (KeyframeId id : map_.window()) {
    const std::vector<LandmarkId>& seen = map_.map().keyframes.at(id).line_landmarks;
    wanted.insert(seen.begin(), seen.end());
  }
  wanted.erase(kNoLandmark);
  for (LandmarkId id : keyframe.line_landmarks) wanted.erase(id);
  const Rigid3 cam_from_world = keyframe.world_from_cam.Inverse();
  for (LandmarkId id : wanted) {
    const LineLandmark& landmark = map_.map().line_landmarks.at(id);
    const auto image = ImageOf(map_.stereo().camera, cam_from_world, landmark);
    if (!image) continue;
    int best = -1;
    double best_error = options_.max_end_error, second_error = best_error;
    for (std::size_t i = 0; i < keyframe.lines.size(); ++i) {
      const double error = Misfit(ToImageSegment(keyframe.lines[i]), *image);
      if (error < best_error) {
        best = static_cast<int>(i);
        second_error = best_error;
        best_error = error;
      } else {
        second_error = std::min(second_error, error);
      }
    }
    constexpr double kClear = 0.5;  // of the runner-up's error
    if (best < 0 || best_error > kClear * second_error) continue;
    if (keyframe.line_landmarks[best] != kNoLandmark || !Shows(keyframe, best, landmark)) continue;
    keyframe.line_landmarks[best] = id;
  }
}

std::vector<LinePoint> LineBuilder::PointsOf(const Keyframe& keyframe,
                                             const std::vector<int>& indices) const {
  std::vector<LinePoint> points;
  for (int index : indices) {
    if (keyframe.landmarks[index] == kNoLandmark) continue;
    const Keypoint& k = keyframe.keypoints[index];
    points.push_back(
        {{k.x, k.y}, map_.map().landmarks.at(keyframe.landmarks[index]).point_in_world});
  }
  return points;
}

void LineBuilder::AddSightings(const Keyframe& keyframe, int line,
                               std::vector<LineSighting>& sightings) const {
  const LineObservation seen = ObservationOf(keyframe, line, options_.pixel_sigma);
  const Rigid3 cam_from_world = keyframe.world_from_cam.Inverse();
  const StereoCamera& stereo = map_.stereo();
  sightings.push_back({cam_from_world, stereo.camera, seen.left});
  if (seen.right) {
    sightings.push_back({RightFromLeft(stereo) * cam_from_world, stereo.camera, *seen.right});
  }
}

LineChanges LineBuilder::FindLandmarks(Keyframe& keyframe) {
  LineChanges changes;
  changes.keyframe = keyframe.id;
  const Tracks tracks = FollowLines(keyframe);
  Inherit(tracks, keyframe);
  SeekLandmarks(keyframe);
  const PointLineAssociation here = Associate(keyframe);
  for (std::size_t i = 0; i < keyframe.lines.size(); ++i) {
    if (keyframe.line_landmarks[i] != kNoLandmark) continue;
    std::vector<LineSighting> sightings;
    AddSightings(keyframe, static_cast<int>(i), sightings);
    std::vector<FeatureRef> earlier;  // that see a line without a landmark
    for (const FeatureRef& ref : tracks[i]) {
      const Keyframe& other = map_.map().keyframes.at(ref.keyframe);
      if (other.line_landmarks[ref.index] != kNoLandmark) continue;
      AddSightings(other, ref.index, sightings);
      earlier.push_back(ref);
    }
    const LineTriangulation line = TriangulateLine(
        sightings, PointsOf(keyframe, here.points_of_line[i]), TriangulationOptions());
    if (!line) continue;
    const auto ends = ObservedStretch(*line.line_in_world, sightings);
    if (!ends || (ends->end - ends->start).norm() > options_.max_length) continue;
    const KeyframeId first = earlier.empty() ? keyframe.id : earlier.back().keyframe;
    const LandmarkId id = map_.lines().Add(*ends, first);
    keyframe.line_landmarks[i] = id;
    changes.added.push_back(id);
    for (auto ref = earlier.rbegin(); ref != earlier.rend(); ++ref) {
      map_.lines().AddObservation(id, *ref);
      changes.observed.push_back(ref->keyframe);
    }
  }
  std::sort(changes.observed.begin(), changes.observed.end());
  changes.observed.erase(std::unique(changes.observed.begin(), changes.observed.end()),
                         changes.observed.end());
  return changes;
}

}  // namespace airslam
