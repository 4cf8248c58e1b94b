// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/local_lines.h"

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>
#include <limits>

#include "airslam/feature/point_line_association.h"
#include "airslam/optimize/line_manifold.h"
#include "airslam/optimize/line_residual.h"
#include "airslam/optimize/pose_parameter.h"

namespace airslam {
namespace {

constexpr double kMinLength = 0.02;  // metres: ends closer together say no direction

}  // namespace

LineObservation ObservationOf(const Keyframe& keyframe, int line, double pixel_sigma) {
  LineObservation seen{ToImageSegment(keyframe.lines[line]), std::nullopt, pixel_sigma};
  const LineSegment& right = keyframe.right_lines[line];
  if (right.score >= 0) seen.right = ToImageSegment(right);
  return seen;
}

std::optional<SpaceSegment> ObservedStretch(const PluckerLine& line_in_world,
                                            std::span<const LineSighting> sightings) {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const LineSighting& sighting : sightings) {
    const auto seen =
        SegmentSeenAt(sighting.camera, sighting.cam_from_world * line_in_world, sighting.segment);
    if (!seen) continue;
    const Rigid3 world_from_cam = sighting.cam_from_world.Inverse();
    for (const Eigen::Vector3d& end : {seen->start, seen->end}) {
      const double place = line_in_world.v.dot(world_from_cam * end);
      low = std::min(low, place);
      high = std::max(high, place);
    }
  }
  if (!(high - low >= kMinLength)) return std::nullopt;
  const Eigen::Vector3d foot = line_in_world.Closest();
  return SpaceSegment{foot + low * line_in_world.v, foot + high * line_in_world.v};
}

LandmarkId LocalLines::Add(const SpaceSegment& ends_in_world, KeyframeId first) {
  const LandmarkId id = next_++;
  map_.line_landmarks[id] = {id, ends_in_world, first};
  seen_by_[id] = {};
  return id;
}

void LocalLines::AddObservation(LandmarkId id, const FeatureRef& ref) {
  map_.keyframes.at(ref.keyframe).line_landmarks[ref.index] = id;
  seen_by_.at(id).push_back(ref);
}

void LocalLines::AddKeyframe(const Keyframe& keyframe) {
  for (std::size_t i = 0; i < keyframe.line_landmarks.size(); ++i) {
    if (keyframe.line_landmarks[i] == kNoLandmark) continue;
    seen_by_.at(keyframe.line_landmarks[i]).push_back({keyframe.id, static_cast<int>(i)});
  }
}

void LocalLines::AddTo(std::span<const KeyframeId> window, const std::map<KeyframeId, int>& pose_of,
                       BundleJob& job) const {
  std::set<LandmarkId> lines;
  for (KeyframeId id : window) {
    for (LandmarkId line : map_.keyframes.at(id).line_landmarks) {
      if (line != kNoLandmark) lines.insert(line);
    }
  }
  for (LandmarkId id : lines) {
    std::vector<FeatureRef> refs = seen_by_.at(id);
    std::erase_if(refs, [&](const FeatureRef& r) { return !pose_of.contains(r.keyframe); });
    // What one keyframe alone sees says nothing about poses, and goes along with it.
    if (refs.size() == 1) {
      job.carried_lines.emplace_back(id, refs.front().keyframe);
      continue;
    }
    const int line = static_cast<int>(job.line_landmarks.size());
    job.line_landmarks.push_back(id);
    job.problem.lines_in_world.push_back(map_.line_landmarks.at(id).line_in_world());
    for (const FeatureRef& ref : refs) {
      job.line_observations.push_back(ref);
      job.problem.line_observations.push_back(
          {pose_of.at(ref.keyframe), line,
           ObservationOf(map_.keyframes.at(ref.keyframe), ref.index, options_.pixel_sigma)});
    }
  }
}

void LocalLines::RemoveObservation(const FeatureRef& ref) {
  LandmarkId& landmark = map_.keyframes.at(ref.keyframe).line_landmarks[ref.index];
  std::erase_if(seen_by_.at(landmark), [&](const FeatureRef& r) {
    return r.keyframe == ref.keyframe && r.index == ref.index;
  });
  landmark = kNoLandmark;
}

// Moves a landmark onto a line and gives it the ends that were observed. False when they cannot be
// said.
bool LocalLines::Place(const PluckerLine& line_in_world, LandmarkId id) {
  const StereoCamera& stereo = map_.calibration.stereo;
  std::vector<LineSighting> sightings;
  for (const FeatureRef& ref : seen_by_.at(id)) {
    const Keyframe& keyframe = map_.keyframes.at(ref.keyframe);
    sightings.push_back({keyframe.world_from_cam.Inverse(), stereo.camera,
                         ToImageSegment(keyframe.lines[ref.index])});
  }
  const auto ends = ObservedStretch(line_in_world, sightings);
  if (ends) map_.line_landmarks.at(id).ends_in_world = *ends;
  return ends.has_value();
}

bool LocalLines::IsPlausible(const LineLandmark& landmark) const {
  const SpaceSegment& ends = landmark.ends_in_world;
  if ((ends.end - ends.start).norm() > options_.max_length) return false;
  const Keyframe& last = map_.keyframes.at(seen_by_.at(landmark.id).back().keyframe);
  const Rigid3 cam_from_world = last.world_from_cam.Inverse();
  return (cam_from_world * ends.start).norm() <= options_.max_depth &&
         (cam_from_world * ends.end).norm() <= options_.max_depth;
}

// The standard deviation of the depth of the line's ends as its last keyframe sees them, as a share
// of the depth, of the worse end: from the information of all observations, poses taken as exact.
// Infinite when they leave a direction open.
double LocalLines::DepthError(const LineLandmark& landmark) const {
  constexpr double kInfinite = std::numeric_limits<double>::infinity();
  const StereoCamera& stereo = map_.calibration.stereo;
  const LineManifold manifold;
  const LineParameter parameter = ToParameter(landmark.line_in_world());
  const LineInWorld line_in_world(parameter.data());
  Eigen::Matrix4d information = Eigen::Matrix4d::Zero();
  const std::vector<FeatureRef>& refs = seen_by_.at(landmark.id);
  for (const FeatureRef& ref : refs) {
    const Keyframe& keyframe = map_.keyframes.at(ref.keyframe);
    const LineResidual residual(stereo, ObservationOf(keyframe, ref.index, options_.pixel_sigma),
                                CameraView(ToParameter(keyframe.world_from_cam).data()),
                                line_in_world, true);
    information += residual.by_line.transpose() * residual.by_line;
  }
  const Keyframe& last = map_.keyframes.at(refs.back().keyframe);
  const Rigid3 cam_from_world = last.world_from_cam.Inverse();
  const ImageSegment segment = ToImageSegment(last.lines[refs.back().index]);
  const auto depths = [&](const LineParameter& line) -> std::optional<Eigen::Vector2d> {
    const auto seen =
        SegmentSeenAt(stereo.camera, cam_from_world * LineFromParameter(line), segment);
    if (!seen) return std::nullopt;
    return Eigen::Vector2d(seen->start.z(), seen->end.z());
  };
  const auto here = depths(parameter);
  if (!here) return kInfinite;
  constexpr double kStep = 1e-6;
  Eigen::Matrix<double, 2, 4> depth_by_step;
  for (int k = 0; k < 4; ++k) {
    const Eigen::Vector4d step = kStep * Eigen::Vector4d::Unit(k);
    LineParameter moved;
    manifold.Plus(parameter.data(), step.data(), moved.data());
    const auto there = depths(moved);
    if (!there) return kInfinite;
    depth_by_step.col(k) = (*there - *here) / kStep;
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d> axes(information);
  const Eigen::Vector4d& known = axes.eigenvalues();  // ascending
  if (!(known[0] > 1e-12 * known[3])) return kInfinite;
  const Eigen::Matrix<double, 2, 4> along = depth_by_step * axes.eigenvectors();
  const Eigen::Matrix2d covariance = along * known.cwiseInverse().asDiagonal() * along.transpose();
  return std::sqrt(std::max(covariance(0, 0) / ((*here)[0] * (*here)[0]),
                            covariance(1, 1) / ((*here)[1] * (*here)[1])));
}

// Whether the keyframes that see it tell where it is.
bool LocalLines::IsKnown(const LineLandmark& landmark) const {
  return seen_by_.at(landmark.id).size() > 1 && IsPlausible(landmark) &&
         DepthError(landmark) <= options_.max_depth_error;
}

// A new line may wait for more keyframes to see it.
bool LocalLines::IsWorthKeeping(const LineLandmark& landmark) const {
  const KeyframeId latest = map_.keyframes.rbegin()->first;
  if (latest - landmark.first_seen_by >= options_.patience) return IsKnown(landmark);
  return !seen_by_.at(landmark.id).empty() && IsPlausible(landmark);
}

void LocalLines::Forget(LandmarkId id, std::set<KeyframeId>& changed, MapWriter::Update& update) {
  const std::vector<FeatureRef> refs = seen_by_.at(id);
  for (const FeatureRef& ref : refs) {
    RemoveObservation(ref);
    changed.insert(ref.keyframe);
  }
  seen_by_.erase(id);
  map_.line_landmarks.erase(id);
  update.removed_line_landmarks.push_back(id);
}

void LocalLines::ReportChanged(const std::set<KeyframeId>& changed,
                               MapWriter::Update& update) const {
  for (KeyframeId id : changed) {
    update.keyframe_line_landmarks.emplace_back(id, map_.keyframes.at(id).line_landmarks);
  }
}

void LocalLines::Apply(const BundleJob& solved, const std::map<KeyframeId, Rigid3>& new_from_old,
                       MapWriter::Update& update) {
  std::set<KeyframeId> changed;
  for (std::size_t i = 0; i < solved.line_observations.size(); ++i) {
    if (!solved.summary.line_outlier[i]) continue;
    RemoveObservation(solved.line_observations[i]);
    changed.insert(solved.line_observations[i].keyframe);
  }
  std::vector<LandmarkId> touched;
  for (std::size_t i = 0; i < solved.line_landmarks.size(); ++i) {
    const LandmarkId id = solved.line_landmarks[i];
    if (Place(solved.problem.lines_in_world[i], id)) {
      touched.push_back(id);
    } else {
      Forget(id, changed, update);
    }
  }
  for (const auto& [id, keyframe] : solved.carried_lines) {
    SpaceSegment& ends = map_.line_landmarks.at(id).ends_in_world;
    ends = {new_from_old.at(keyframe) * ends.start, new_from_old.at(keyframe) * ends.end};
    touched.push_back(id);
  }
  for (LandmarkId id : touched) {
    const LineLandmark& landmark = map_.line_landmarks.at(id);
    if (IsWorthKeeping(landmark)) {
      update.line_landmarks.push_back(landmark);
    } else {
      Forget(id, changed, update);
    }
  }
  ReportChanged(changed, update);
}

void LocalLines::Settle(MapWriter::Update& update) {
  std::vector<LandmarkId> unknown;
  for (const auto& [id, landmark] : map_.line_landmarks) {
    if (!IsKnown(landmark)) unknown.push_back(id);
  }
  std::set<KeyframeId> changed;
  for (LandmarkId id : unknown) Forget(id, changed, update);
  ReportChanged(changed, update);
}

}  // namespace airslam
