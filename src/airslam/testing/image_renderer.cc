// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/testing/image_renderer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace airslam {
namespace {

// A well-mixed 32-bit hash of a lattice cell, as a number in [0, 1).
double CellNoise(std::int32_t x, std::int32_t y, std::uint32_t seed) {
  std::uint32_t h = seed * 0x9E3779B1u ^ static_cast<std::uint32_t>(x) * 0x85EBCA77u ^
                    static_cast<std::uint32_t>(y) * 0xC2B2AE3Du;
  h ^= h >> 15;
  h *= 0x2C1B3C6Du;
  h ^= h >> 12;
  h *= 0x297A2D39u;
  h ^= h >> 15;
  return h * (1.0 / 4294967296.0);
}

double SmoothStep(double t) {
  t = std::clamp(t, 0.0, 1.0);
  return t * t * (3 - 2 * t);
}

// Lattice values joined by steps whose width is a fraction `edge` of a cell: patches with soft
// edges; edge = 1 gives ordinary value noise.
double PatchNoise(double x, double y, double edge, std::uint32_t seed) {
  const double floor_x = std::floor(x), floor_y = std::floor(y);
  const auto ix = static_cast<std::int32_t>(floor_x), iy = static_cast<std::int32_t>(floor_y);
  const double tx = SmoothStep((x - floor_x - 0.5) / edge + 0.5);
  const double ty = SmoothStep((y - floor_y - 0.5) / edge + 0.5);
  const double top = CellNoise(ix, iy, seed) * (1 - tx) + CellNoise(ix + 1, iy, seed) * tx;
  const double bottom =
      CellNoise(ix, iy + 1, seed) * (1 - tx) + CellNoise(ix + 1, iy + 1, seed) * tx;
  return top * (1 - ty) + bottom * ty;
}

struct Octave {
  double cell;          // metres
  double amplitude;     // the albedo's peak to peak
  double edge;          // width of the steps in metres, at the most one cell
  double cosine, sine;  // the lattice's turn, so that the octaves' lattices do not line up
};

constexpr std::array<Octave, 6> kOctaves = {{
    {1.10, 0.20, 1.100, 1.0, 0.0},
    {0.43, 0.34, 0.012, 0.9848, 0.1736},
    {0.19, 0.26, 0.010, 0.9063, -0.4226},
    {0.085, 0.18, 0.008, 0.8192, 0.5736},
    {0.040, 0.10, 0.040, 0.9397, 0.3420},
    {0.020, 0.07, 0.020, 0.7660, -0.6428},
}};

}  // namespace

double SurfaceAlbedo(std::uint32_t texture, int face, double u, double v, double footprint) {
  const std::uint32_t seed = texture * 8u + static_cast<std::uint32_t>(face);
  double albedo = 0.30 + 0.35 * CellNoise(face, 77, seed);  // each face its own grey
  std::uint32_t octave_seed = seed * 16u;
  for (const Octave& octave : kOctaves) {
    ++octave_seed;
    const double fineness = footprint / octave.cell;
    const double weight = 1 - SmoothStep((fineness - 0.25) / 0.5);
    if (weight <= 0) break;
    const double x = (octave.cosine * u - octave.sine * v) / octave.cell;
    const double y = (octave.sine * u + octave.cosine * v) / octave.cell;
    const double edge = std::min(1.0, octave.edge / octave.cell + 1.5 * fineness);
    albedo += weight * octave.amplitude * (PatchNoise(x, y, edge, octave_seed) - 0.5);
  }
  return std::clamp(albedo, 0.02, 1.0);
}

struct ImageRenderer::Frame {
  std::vector<PosedBox> boxes;
  std::vector<Eigen::Vector3d> centres_in_cam;
  std::vector<double> radii;
  Illumination light;
  cv::Mat surface;  // CV_32SC1, 8 * box + face, or -1
  cv::Mat shade;    // CV_32FC1, grey value before noise
};

ImageRenderer::ImageRenderer(const SyntheticWorld& world, const DistortedCamera& camera)
    : world_(world), size_(camera.pinhole.width, camera.pinhole.height), focal_(camera.pinhole.fx) {
  rays_.resize(static_cast<std::size_t>(size_.area()), Eigen::Vector3d::Zero());
  for (int y = 0; y < size_.height; ++y) {
    for (int x = 0; x < size_.width; ++x) {
      Eigen::Vector3d ray;
      if (camera.Unproject({x, y}, &ray)) rays_[y * size_.width + x] = ray / ray.z();
    }
  }
  for (int y = 0; y < size_.height; y += kTile) {
    for (int x = 0; x < size_.width; x += kTile) {
      Tile tile{cv::Rect(x, y, kTile, kTile) & cv::Rect({0, 0}, size_), {0, 0, 0}, 0};
      const auto for_each_ray = [&](auto&& action) {
        for (int row = tile.area.y; row < tile.area.br().y; ++row) {
          for (int column = tile.area.x; column < tile.area.br().x; ++column) {
            if (Ray(column, row).z() > 0) action(Ray(column, row).normalized());
          }
        }
      };
      for_each_ray([&](const Eigen::Vector3d& ray) { tile.axis += ray; });
      if (tile.axis.isZero()) continue;
      tile.axis.normalize();
      double cosine = 1;
      for_each_ray(
          [&](const Eigen::Vector3d& ray) { cosine = std::min(cosine, tile.axis.dot(ray)); });
      tile.half_angle = std::acos(std::clamp(cosine, -1.0, 1.0)) + 2.0 / focal_;
      tiles_.push_back(tile);
    }
  }
}

RayHit ImageRenderer::CastIn(const Frame& frame, const std::vector<int>& boxes,
                             const Eigen::Vector3d& ray_in_cam) const {
  RayHit best;
  best.distance = std::numeric_limits<double>::infinity();
  for (const int index : boxes) {
    const PosedBox& posed = frame.boxes[index];
    const auto hit =
        CastBox(world_.boxes()[index], index == 0, posed.eye, posed.box_from_cam * ray_in_cam);
    if (hit && hit->distance < best.distance) {
      best = *hit;
      best.box = index;
    }
  }
  return best;
}

double ImageRenderer::Shade(const Frame& frame, const RayHit& hit,
                            const Eigen::Vector3d& ray_in_cam) const {
  const double footprint = hit.distance / focal_ / std::sqrt(std::max(hit.cosine, 0.02));
  const double albedo =
      SurfaceAlbedo(world_.boxes()[hit.box].texture, hit.face, hit.u, hit.v, footprint);
  double light = frame.light.ambient;
  if (frame.light.lamp > 0) {
    const double off_axis = std::atan2(ray_in_cam.head<2>().norm(), 1.0);
    const double ratio = off_axis / frame.light.lamp_half_angle;
    const double range = std::max(1.5, hit.distance * ray_in_cam.norm());
    light += frame.light.lamp * std::exp(-ratio * ratio) / (range * range) * hit.cosine;
  }
  return 255.0 * albedo * light;
}

void ImageRenderer::DrawTile(const Tile& tile, Frame& frame, RenderedImage& out) const {
  std::vector<int> boxes = {0};
  for (int i = 1; i < static_cast<int>(frame.boxes.size()); ++i) {
    const double distance = frame.centres_in_cam[i].norm();
    if (distance > frame.radii[i]) {
      const double angle =
          std::acos(std::clamp(tile.axis.dot(frame.centres_in_cam[i]) / distance, -1.0, 1.0));
      if (angle > tile.half_angle + std::asin(frame.radii[i] / distance)) continue;
    }
    boxes.push_back(i);
  }
  for (int y = tile.area.y; y < tile.area.br().y; ++y) {
    for (int x = tile.area.x; x < tile.area.br().x; ++x) {
      const Eigen::Vector3d& ray = Ray(x, y);
      if (ray.z() == 0) continue;
      const RayHit hit = CastIn(frame, boxes, ray);
      if (hit.box < 0) continue;
      frame.surface.at<int>(y, x) = 8 * hit.box + hit.face;
      out.depth.at<float>(y, x) = static_cast<float>(hit.distance);
      frame.shade.at<float>(y, x) = static_cast<float>(Shade(frame, hit, ray));
    }
  }
}

void ImageRenderer::SmoothEdges(Frame& frame) const {
  const cv::Mat shade = frame.shade.clone();
  for (int y = 1; y + 1 < size_.height; ++y) {
    for (int x = 1; x + 1 < size_.width; ++x) {
      const int self = frame.surface.at<int>(y, x);
      std::vector<int> boxes;
      bool edge = false;
      for (const auto& [dx, dy] : {std::pair(-1, 0), {1, 0}, {0, -1}, {0, 1}}) {
        const int other = frame.surface.at<int>(y + dy, x + dx);
        if (other < 0) boxes.clear(), edge = false;
        if (other < 0 || self < 0) break;
        edge = edge || other != self;
        if (std::find(boxes.begin(), boxes.end(), other / 8) == boxes.end()) {
          boxes.push_back(other / 8);
        }
      }
      if (!edge) continue;
      if (std::find(boxes.begin(), boxes.end(), self / 8) == boxes.end()) boxes.push_back(self / 8);
      const Eigen::Vector3d along_x = (Ray(x + 1, y) - Ray(x - 1, y)) / 6;
      const Eigen::Vector3d along_y = (Ray(x, y + 1) - Ray(x, y - 1)) / 6;
      double sum = 0;
      for (int i = 0; i < 9; ++i) {
        const Eigen::Vector3d ray = Ray(x, y) + (i % 3 - 1) * along_x + (i / 3 - 1) * along_y;
        const RayHit hit = CastIn(frame, boxes, ray);
        sum += hit.box < 0 ? shade.at<float>(y, x) : Shade(frame, hit, ray);
      }
      frame.shade.at<float>(y, x) = static_cast<float>(sum / 9);
    }
  }
}

RenderedImage ImageRenderer::Render(const Rigid3& world_from_cam,
                                    const Illumination& illumination) const {
  const Rigid3 cam_from_world = world_from_cam.Inverse();
  const Eigen::Matrix3d world_axes = world_from_cam.rotation.toRotationMatrix();
  Frame frame;
  frame.light = illumination;
  frame.surface = cv::Mat(size_, CV_32SC1, cv::Scalar(-1));
  frame.shade = cv::Mat::zeros(size_, CV_32FC1);
  for (const WorldBox& box : world_.boxes()) {
    PosedBox posed;
    posed.eye = box.ToLocal(world_from_cam.translation);
    for (int i = 0; i < 3; ++i) posed.box_from_cam.col(i) = box.DirectionToLocal(world_axes.col(i));
    frame.boxes.push_back(posed);
    frame.centres_in_cam.push_back(cam_from_world * box.centre);
    frame.radii.push_back(box.half_size.norm());
  }
  RenderedImage out;
  out.depth = cv::Mat::zeros(size_, CV_32FC1);
  for (const Tile& tile : tiles_) DrawTile(tile, frame, out);
  SmoothEdges(frame);
  if (illumination.noise > 0) {
    cv::Mat noise(size_, CV_32FC1);
    cv::RNG random(0x9E3779B97F4A7C15ull ^ illumination.noise_seed);
    random.fill(noise, cv::RNG::NORMAL, 0.0, illumination.noise);
    frame.shade += noise;
  }
  frame.shade.convertTo(out.image, CV_8UC1);
  return out;
}

}  // namespace airslam
