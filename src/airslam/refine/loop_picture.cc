// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/refine/loop_picture.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace airslam {
namespace {

constexpr int kSize = 1000, kMargin = 60;  // pixels
const cv::Scalar kGrey(190, 190, 190), kOrange(30, 140, 255), kBlue(200, 80, 20), kRed(40, 40, 230),
    kBlack(0, 0, 0);

// Metres to pixels, seen along the direction in which the path is thinnest.
class View {
 public:
  explicit View(const std::vector<Eigen::Vector3d>& path) {
    Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
    for (const Eigen::Vector3d& p : path) centre_ += p / static_cast<double>(path.size());
    for (const Eigen::Vector3d& p : path) scatter += (p - centre_) * (p - centre_).transpose();
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(scatter);
    right_ = axes.eigenvectors().col(2);
    up_ = axes.eigenvectors().col(1);
    double reach = 1;
    for (const Eigen::Vector3d& p : path) {
      reach = std::max({reach, std::abs(right_.dot(p - centre_)), std::abs(up_.dot(p - centre_))});
    }
    scale_ = (kSize / 2 - kMargin) / reach;
  }

  cv::Point Pixel(const Eigen::Vector3d& p) const {
    const double x = kSize / 2 + scale_ * right_.dot(p - centre_);
    const double y = kSize / 2 - scale_ * up_.dot(p - centre_);
    constexpr double kFar = 1e4;  // OpenCV's lines need not reach further
    return {static_cast<int>(std::lround(std::clamp(x, -kFar, kFar))),
            static_cast<int>(std::lround(std::clamp(y, -kFar, kFar)))};
  }
  double pixels_per_metre() const { return scale_; }

 private:
  Eigen::Vector3d centre_ = Eigen::Vector3d::Zero(), right_, up_;
  double scale_ = 1;
};

void DrawPath(const Map& map, const std::map<KeyframeId, Rigid3>& poses, const View& view,
              const cv::Scalar& color, cv::Mat& picture) {
  const Keyframe* previous = nullptr;
  for (const auto& [id, pose] : poses) {
    const auto entry = map.keyframes.find(id);
    if (entry == map.keyframes.end()) continue;
    const Keyframe& keyframe = entry->second;
    const cv::Point at = view.Pixel(pose.translation);
    if (previous != nullptr && previous->component == keyframe.component) {
      cv::line(picture, view.Pixel(poses.at(previous->id).translation), at, color, 1, cv::LINE_AA);
    }
    cv::circle(picture, at, 3, color, cv::FILLED, cv::LINE_AA);
    previous = &keyframe;
  }
}

void DrawLegend(std::size_t loops, const View& view, cv::Mat& picture) {
  const double metres =
      std::pow(10, std::floor(std::log10(0.25 * kSize / view.pixels_per_metre())));
  const int length = static_cast<int>(metres * view.pixels_per_metre());
  cv::line(picture, {20, kSize - 20}, {20 + length, kSize - 20}, kBlack, 2);
  const auto write = [&](const std::string& text, int x, int y, const cv::Scalar& color) {
    cv::putText(picture, text, {x, y}, cv::FONT_HERSHEY_SIMPLEX, 0.5, color, 1, cv::LINE_AA);
  };
  write(fmt::format("{:g} m", metres), 30 + length, kSize - 16, kBlack);
  write("before", 20, 25, kOrange);
  write("after", 90, 25, kBlue);
  write(fmt::format("{} loops", loops), 150, 25, kRed);
}

}  // namespace

cv::Mat DrawLoops(const Map& map, const std::map<KeyframeId, Rigid3>& before,
                  const std::vector<Loop>& loops) {
  cv::Mat picture(kSize, kSize, CV_8UC3, cv::Scalar::all(255));
  std::map<KeyframeId, Rigid3> after;
  std::vector<Eigen::Vector3d> path;
  for (const auto& [id, keyframe] : map.keyframes) {
    after[id] = keyframe.world_from_cam;
    path.push_back(keyframe.world_from_cam.translation);
  }
  if (path.empty()) return picture;
  const View view(path);
  const cv::Rect frame(0, 0, kSize, kSize);
  for (const auto& [id, landmark] : map.landmarks) {
    const cv::Point at = view.Pixel(landmark.point_in_world);
    if (frame.contains(at)) cv::circle(picture, at, 1, kGrey, cv::FILLED);
  }
  DrawPath(map, before, view, kOrange, picture);
  DrawPath(map, after, view, kBlue, picture);
  for (const Loop& loop : loops) {
    if (!after.contains(loop.earlier) || !after.contains(loop.later)) continue;
    cv::line(picture, view.Pixel(after.at(loop.earlier).translation),
             view.Pixel(after.at(loop.later).translation), kRed, 1, cv::LINE_AA);
  }
  DrawLegend(loops.size(), view, picture);
  return picture;
}

}  // namespace airslam
