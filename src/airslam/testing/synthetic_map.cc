// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/testing/synthetic_map.h"

#include <cmath>
#include <memory>

#include "airslam/geometry/so3.h"
#include "airslam/testing/synthetic_rig.h"

namespace airslam {
namespace {

constexpr int kDescriptorSize = 64;
constexpr double kBuildingDistance = 25;  // metres
constexpr std::int64_t kStart = 1'700'000'000'000'000'000;

Eigen::VectorXf RandomDirection(std::mt19937& random) {
  Eigen::VectorXf direction(kDescriptorSize);
  for (int i = 0; i < kDescriptorSize; ++i) direction[i] = static_cast<float>(Normal(random));
  return direction.normalized();
}

Eigen::Vector3d RandomVector(std::mt19937& random) {
  return {Normal(random), Normal(random), Normal(random)};
}

// A building with a descriptor for each of its points.
struct Building {
  Building(const SyntheticMapOptions& options, int copy) : world(Options(options, copy)) {
    std::mt19937 random(options.seed * 7919 + static_cast<std::uint32_t>(copy));
    for (std::size_t i = 0; i < world.points().size(); ++i) {
      descriptors.push_back(RandomDirection(random));
    }
  }
  static SyntheticWorldOptions Options(const SyntheticMapOptions& options, int copy) {
    SyntheticWorldOptions world = options.world;
    world.seed += static_cast<std::uint32_t>(copy);
    return world;
  }

  SyntheticWorld world;
  std::vector<Eigen::VectorXf> descriptors;
};

// Makes the keyframes one after the other.
class Maker {
 public:
  explicit Maker(const SyntheticMapOptions& options)
      : options_(options), rig_(IdealRig()), random_(options.seed) {
    Map& map = result_.map;
    map.calibration.stereo = {rig_.left.camera.pinhole, rig_.Baseline()};
    map.calibration.body_from_left = rig_.left.body_from_cam;
    map.model_pack = "synthetic";
    map.model_pack_sha256 = std::string(64, '0');
    bias_ = {options.drift_angle * RandomVector(random_), options.drift * RandomVector(random_)};
  }

  SyntheticMap Make() {
    SyntheticTrajectory trajectory = options_.trajectory;
    trajectory.Mount(HeadingFromBody(rig_), kStart);
    for (int copy = 0; copy < options_.copies; ++copy) {
      const Building building(options_, copy);
      last_seen_.clear();
      const Eigen::Vector3d offset(kBuildingDistance * copy, 0, 0);
      const auto states = trajectory.Sample(1 / options_.interval, options_.keyframes);
      for (const BodyState& state : states) {
        AddKeyframe(building, state.world_from_body * rig_.left.body_from_cam, offset);
      }
    }
    return std::move(result_);
  }

 private:
  struct Drift {
    Eigen::Vector3d turn = Eigen::Vector3d::Zero(), move = Eigen::Vector3d::Zero();
  };

  // The pose that odometry believes: the last one, moved on by the true motion and an error.
  Rigid3 Estimate(const Rigid3& truth) {
    if (result_.true_world_from_cam.empty()) return truth;
    const Rigid3& last_truth = result_.true_world_from_cam.rbegin()->second;
    const Rigid3& last = result_.map.keyframes.rbegin()->second.world_from_cam;
    const Rigid3 error(ExpSO3(bias_.turn + options_.drift_angle * RandomVector(random_)),
                       bias_.move + options_.drift * RandomVector(random_));
    return last * last_truth.Inverse() * truth * error;
  }

  void AddKeyframe(const Building& building, const Rigid3& building_from_cam,
                   const Eigen::Vector3d& offset) {
    const Rigid3 truth(building_from_cam.rotation, building_from_cam.translation + offset);
    Keyframe keyframe;
    keyframe.id = static_cast<KeyframeId>(result_.map.keyframes.size());
    keyframe.timestamp_ns =
        kStart + static_cast<std::int64_t>(std::llround(1e9 * options_.interval)) * keyframe.id;
    keyframe.world_from_cam = Estimate(truth);
    std::vector<VisiblePoint> seen = ObservePoints(
        building.world, rig_.left.camera, building_from_cam, options_.pixel_noise, random_);
    const auto count = std::min<std::size_t>(seen.size(), options_.max_keypoints);
    keyframe.descriptors.resize(static_cast<Eigen::Index>(count), kDescriptorSize);
    std::map<int, LandmarkId> now_seen;
    for (std::size_t i = 0; i < count; ++i) {
      // Spread over the world, whose points come in the order of its boxes.
      const VisiblePoint& point = seen[i * seen.size() / count];
      AddKeypoint(building, point, static_cast<Eigen::Index>(i), keyframe, now_seen);
    }
    last_seen_ = std::move(now_seen);
    result_.true_world_from_cam[keyframe.id] = truth;
    result_.map.keyframes[keyframe.id] = std::move(keyframe);
  }

  void AddKeypoint(const Building& building, const VisiblePoint& point, Eigen::Index row,
                   Keyframe& keyframe, std::map<int, LandmarkId>& now_seen) {
    const StereoCamera& stereo = result_.map.calibration.stereo;
    const Eigen::Vector2d& pixel = point.pixel;
    const double disparity = stereo.Disparity(point.depth);
    keyframe.keypoints.push_back(
        {static_cast<float>(pixel.x()), static_cast<float>(pixel.y()), 1.0F});
    keyframe.right_x.push_back(
        static_cast<float>(pixel.x() - disparity + options_.pixel_noise * Normal(random_)));
    const Eigen::VectorXf noise =
        static_cast<float>(options_.descriptor_noise) * RandomDirection(random_);
    keyframe.descriptors.row(row) = (building.descriptors[point.point] + noise).normalized();
    const auto known = last_seen_.find(point.point);
    LandmarkId id = known != last_seen_.end() ? known->second : next_landmark_++;
    keyframe.landmarks.push_back(id);
    now_seen[point.point] = id;
    if (known != last_seen_.end()) return;
    const Eigen::Vector3d ray((pixel.x() - stereo.camera.cx) / stereo.camera.fx,
                              (pixel.y() - stereo.camera.cy) / stereo.camera.fy, 1);
    result_.map.landmarks[id] = {id, keyframe.world_from_cam * Eigen::Vector3d(point.depth * ray),
                                 keyframe.id};
    result_.point_of_landmark[id] = point.point;
  }

  const SyntheticMapOptions& options_;
  const StereoRig rig_;
  std::mt19937 random_;
  Drift bias_;
  std::map<int, LandmarkId> last_seen_;  // points of the last keyframe and their landmarks
  LandmarkId next_landmark_ = 0;
  SyntheticMap result_;
};

}  // namespace

SyntheticMap MakeSyntheticMap(const SyntheticMapOptions& options) { return Maker(options).Make(); }

double KeyframeError(const Map& map, const std::map<KeyframeId, Rigid3>& truth) {
  double squares = 0;
  for (const auto& [id, keyframe] : map.keyframes) {
    squares += (keyframe.world_from_cam.translation - truth.at(id).translation).squaredNorm();
  }
  return std::sqrt(squares / static_cast<double>(std::max<std::size_t>(map.keyframes.size(), 1)));
}

}  // namespace airslam
