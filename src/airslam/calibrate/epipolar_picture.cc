// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/calibrate/epipolar_picture.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace airslam {
namespace {

constexpr double kNearest = 0.3;       // m
constexpr double kStepInDepth = 0.98;  // from one point of a curve to the next, in 1 / distance
constexpr int kShift = 3;              // drawing at eighths of a pixel

// A well visible colour for each number, far from that of its neighbours.
cv::Scalar ColourOf(int number) {
  const cv::Mat hsv(1, 1, CV_8UC3, cv::Scalar((number * 67) % 180, 220, 255));
  cv::Mat bgr;
  cv::cvtColor(hsv, bgr, cv::COLOR_HSV2BGR);
  const cv::Vec3b c = bgr.at<cv::Vec3b>(0, 0);
  return {double(c[0]), double(c[1]), double(c[2])};
}

cv::Point At(const Eigen::Vector2d& pixel, int offset) {
  return {cvRound((pixel.x() + offset) * (1 << kShift)), cvRound(pixel.y() * (1 << kShift))};
}

// Matches of the frame, evenly chosen in the order of their columns and rows.
std::vector<const RawMatch*> Choose(const RawMatches& matches, int frame, int count) {
  std::vector<const RawMatch*> of_frame;
  for (const RawMatch& match : matches.matches) {
    if (match.frame == frame) of_frame.push_back(&match);
  }
  std::stable_sort(of_frame.begin(), of_frame.end(),
                   [](const RawMatch* a, const RawMatch* b) { return a->left.y() < b->left.y(); });
  std::vector<const RawMatch*> chosen;
  const auto step = std::max<std::size_t>(1, of_frame.size() / static_cast<std::size_t>(count));
  for (std::size_t i = step / 2; i < of_frame.size(); i += step) chosen.push_back(of_frame[i]);
  return chosen;
}

// Where the right camera sees a point of the left one's ray, from far to near.
void DrawCurve(const StereoRig& rig, const Eigen::Vector2d& left, const cv::Scalar& colour,
               cv::Mat& canvas) {
  Eigen::Vector3d ray;
  if (!rig.left.camera.Unproject(left, &ray)) return;
  const Rigid3 right_from_left = rig.right.body_from_cam.Inverse() * rig.left.body_from_cam;
  const double max_radius = rig.right.camera.MaxRadius();
  const cv::Rect right(canvas.cols / 2, 0, canvas.cols / 2, canvas.rows);
  cv::Mat part = canvas(right);
  std::vector<cv::Point> points;
  for (double inverse = 1e-4; inverse < 1 / kNearest; inverse /= kStepInDepth) {
    const Eigen::Vector3d point = right_from_left * Eigen::Vector3d(ray / inverse);
    if (point.z() <= 0 || point.hnormalized().norm() >= max_radius) continue;
    const Eigen::Vector2d pixel = rig.right.camera.Project(point);
    if (pixel.cwiseAbs().maxCoeff() < 10'000) points.push_back(At(pixel, 0));
  }
  if (points.size() > 1) {
    cv::polylines(part, points, false, colour, 1, cv::LINE_AA, kShift);
  }
}

}  // namespace

cv::Mat DrawEpipolarCurves(const StereoRig& rig, const StereoPair& pair, const RawMatches& matches,
                           int frame, int curves) {
  const int rows = std::max(pair.left.rows, pair.right.rows);
  const int columns = std::max(pair.left.cols, pair.right.cols);
  cv::Mat canvas(rows, 2 * columns, CV_8UC3, cv::Scalar::all(0));
  cv::cvtColor(pair.left, canvas(cv::Rect(0, 0, pair.left.cols, pair.left.rows)),
               cv::COLOR_GRAY2BGR);
  cv::cvtColor(pair.right, canvas(cv::Rect(columns, 0, pair.right.cols, pair.right.rows)),
               cv::COLOR_GRAY2BGR);
  int number = 0;
  for (const RawMatch* match : Choose(matches, frame, curves)) {
    const cv::Scalar colour = ColourOf(number++);
    DrawCurve(rig, match->left, colour, canvas);
    cv::circle(canvas, At(match->left, 0), 5 << kShift, colour, 2, cv::LINE_AA, kShift);
    cv::circle(canvas, At(match->right, columns), 5 << kShift, colour, 2, cv::LINE_AA, kShift);
  }
  return canvas;
}

}  // namespace airslam
