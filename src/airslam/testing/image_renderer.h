// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "airslam/geometry/rigid3.h"
#include "airslam/sensor/distorted_camera.h"
#include "airslam/testing/synthetic_world.h"

namespace airslam {

// The light of one image. Grey value = 255 * albedo * (ambient + lamp) + noise, clamped to 0..255.
struct Illumination {
  double ambient = 0.9;          // from everywhere
  double lamp = 0;               // of a head lamp at the camera: at 1 m on its optical axis,
                                 // falling with the square of the distance beyond 1.5 m
  double lamp_half_angle = 0.4;  // radians at which the lamp has 1/e of its strength
  double noise = 0;              // standard deviation of the pixels, grey values
  std::uint32_t noise_seed = 0;  // give every image its own

  static Illumination Day() { return {}; }
  // Lights out: a mean grey of about 15 and sensor noise.
  static Illumination Dark(std::uint32_t seed) { return {0.12, 0, 0.4, 2.0, seed}; }
  // A head lamp only.
  static Illumination HeadLamp(std::uint32_t seed) { return {0.03, 16.0, 0.5, 2.0, seed}; }
};

struct RenderedImage {
  cv::Mat image;  // CV_8UC1
  cv::Mat depth;  // CV_32FC1, z in the camera in metres at each pixel's centre; 0: no ray
};

// The texture of the world: albedo in [0, 1] at (u, v) metres on a face. Patches of 0.02 to 1 m
// with soft edges; what is finer than `footprint` (metres, the width of a pixel) fades to its mean,
// so that images are free of aliasing.
double SurfaceAlbedo(std::uint32_t texture, int face, double u, double v, double footprint);

// Draws what one camera sees of the world, by ray casting; edges between surfaces are smoothed by
// 3 x 3 rays. Rectified and distorted cameras alike. Thread-safe; the world must outlive it.
class ImageRenderer {
 public:
  ImageRenderer(const SyntheticWorld& world, const DistortedCamera& camera);

  RenderedImage Render(const Rigid3& world_from_cam, const Illumination& illumination = {}) const;

 private:
  static constexpr int kTile = 16;  // pixels
  struct Tile {
    cv::Rect area;
    Eigen::Vector3d axis;  // in camera, unit length
    double half_angle;     // of the cone around all its rays, radians
  };
  // What a pose makes of the boxes: the eye and the camera's axes in the frame of each.
  struct PosedBox {
    Eigen::Vector3d eye;
    Eigen::Matrix3d box_from_cam;
  };
  struct Frame;

  void DrawTile(const Tile& tile, Frame& frame, RenderedImage& out) const;
  void SmoothEdges(Frame& frame) const;
  RayHit CastIn(const Frame& frame, const std::vector<int>& boxes,
                const Eigen::Vector3d& ray_in_cam) const;
  double Shade(const Frame& frame, const RayHit& hit, const Eigen::Vector3d& ray_in_cam) const;
  const Eigen::Vector3d& Ray(int x, int y) const { return rays_[y * size_.width + x]; }

  const SyntheticWorld& world_;
  cv::Size size_;
  double focal_ = 1;
  std::vector<Eigen::Vector3d> rays_;  // of each pixel, z = 1; zero: the pixel sees nothing
  std::vector<Tile> tiles_;
};

}  // namespace airslam
