// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include <cstdint>
#include <optional>
#include <random>
#include <vector>

#include "airslam/geometry/rigid3.h"
#include "airslam/sensor/distorted_camera.h"

namespace airslam {

struct SyntheticWorldOptions {
  std::uint32_t seed = 1;          // of the boxes' sizes and places, the points and the textures
  int num_points = 1500;           // points on the surfaces, besides the corners
  double length = 16, width = 12;  // of the room along x and y, metres; at least 14 x 10
  double height = 4;               // metres; at least 3.5
};

// A cuboid that stands upright, turned by `yaw` about z.
struct WorldBox {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();     // in world, metres
  Eigen::Vector3d half_size = Eigen::Vector3d::Zero();  // metres
  double yaw = 0;                                       // radians
  std::uint32_t texture = 0;                            // seed of its texture

  Eigen::Vector3d ToLocal(const Eigen::Vector3d& point_in_world) const;
  Eigen::Vector3d DirectionToLocal(const Eigen::Vector3d& direction_in_world) const;
  Eigen::Vector3d ToWorld(const Eigen::Vector3d& point_in_box) const;
};

// A straight edge of the world.
struct WorldSegment {
  Eigen::Vector3d start = Eigen::Vector3d::Zero();  // in world, metres
  Eigen::Vector3d end = Eigen::Vector3d::Zero();
};

// Where a ray meets the world: point = origin + distance * direction.
struct RayHit {
  double distance = 0;  // in units of the ray's direction, > 0
  int box = -1;         // index into boxes(); 0 is the room, seen from inside
  int face = -1;        // 0..5: -x, +x, -y, +y, -z, +z of the box
  double u = 0, v = 0;  // metres along the face
  double cosine = 1;    // of the angle between the ray and the face's normal, > 0
};

// The one synthetic world of tests and benchmarks: a hall with shelves along the walls, crates in
// its middle and beams under the ceiling, all textured; the same for the same options.
//
// World frame: z up, metres, origin on the floor in the middle of the hall. These places are free
// of boxes for the trajectories of synthetic_motion.h: the ring 1.6 < r < 3.4 m around the origin
// and the aisle |x| < 6 m, |y + 2.6 m| < 0.8 m, both for 0.5 m < z < 2.8 m.
class SyntheticWorld {
 public:
  explicit SyntheticWorld(const SyntheticWorldOptions& options = {});

  const std::vector<WorldBox>& boxes() const { return boxes_; }  // [0] is the room
  const std::vector<Eigen::Vector3d>& points() const { return points_; }
  const std::vector<WorldSegment>& segments() const { return segments_; }

  // First surface along a ray that starts inside the hall. Nothing only when it starts outside.
  std::optional<RayHit> Cast(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) const;

  // True when nothing stands between the eye and a point on a surface (tolerance 1 cm).
  bool Visible(const Eigen::Vector3d& eye, const Eigen::Vector3d& point_in_world) const;

 private:
  void AddBox(const Eigen::Vector3d& centre, const Eigen::Vector3d& size, double yaw);
  void AddShelves(const SyntheticWorldOptions& options, std::mt19937& random);
  void AddCrates(std::mt19937& random);
  void AddBeams(const SyntheticWorldOptions& options, std::mt19937& random);
  void AddPointsAndSegments(int num_points, std::mt19937& random);

  std::vector<WorldBox> boxes_;
  std::vector<Eigen::Vector3d> points_;
  std::vector<WorldSegment> segments_;
};

// A uniform number in [low, high), equal with every standard library
// (std::uniform_real_distribution is not).
double Uniform(std::mt19937& random, double low, double high);

// A normally distributed number of mean 0 and standard deviation 1, equal likewise.
double Normal(std::mt19937& random);

// Meets one box from outside (or, with `inside`, from within). Distances below 1e-9 do not count.
std::optional<RayHit> CastBox(const WorldBox& box, bool inside,
                              const Eigen::Vector3d& origin_in_box,
                              const Eigen::Vector3d& direction_in_box);

// A world point seen by a camera.
struct VisiblePoint {
  int point = -1;                                   // index into points()
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();  // in the camera's own (raw) image, with noise
  double depth = 0;                                 // z in the camera, metres, exact
};

// A world segment seen by a camera: the longest visible stretch of it.
struct SegmentObservation {
  int segment = -1;                                 // index into segments()
  Eigen::Vector2d start = Eigen::Vector2d::Zero();  // pixels, with noise
  Eigen::Vector2d end = Eigen::Vector2d::Zero();
  Eigen::Vector3d start_in_world = Eigen::Vector3d::Zero();  // exact, on the segment
  Eigen::Vector3d end_in_world = Eigen::Vector3d::Zero();
};

// The points that a camera sees, in order of their index. Occlusion and the image's border count.
// pixel_noise: standard deviation in pixels, drawn from `random`.
std::vector<VisiblePoint> ObservePoints(const SyntheticWorld& world, const DistortedCamera& camera,
                                        const Rigid3& world_from_cam, double pixel_noise,
                                        std::mt19937& random);

// Likewise the segments of which a stretch of at least `min_pixels` between its ends is visible.
std::vector<SegmentObservation> ObserveSegments(const SyntheticWorld& world,
                                                const DistortedCamera& camera,
                                                const Rigid3& world_from_cam, double pixel_noise,
                                                double min_pixels, std::mt19937& random);

}  // namespace airslam
