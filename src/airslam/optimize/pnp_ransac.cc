// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/pnp_ransac.h"

#include <opencv2/calib3d.hpp>

#include "airslam/common/options.h"

namespace airslam {

void PnpRansacOptions::Validate() const {
  RequireOption(max_error > 0, "max_error", max_error, "must be positive");
  RequireOption(iterations >= 1, "iterations", iterations, "must be at least 1");
  RequireOption(confidence > 0 && confidence < 1, "confidence", confidence,
                "must lie between 0 and 1");
}

PnpRansacResult EstimatePnpRansac(const Pinhole& camera, std::span<const PointSighting> sightings,
                                  const PnpRansacOptions& options) {
  constexpr std::size_t kFewest = 6;
  PnpRansacResult result;
  if (sightings.size() < kFewest) return result;
  std::vector<cv::Point3d> points;
  std::vector<cv::Point2d> pixels;
  for (const PointSighting& s : sightings) {
    points.emplace_back(s.point_in_world.x(), s.point_in_world.y(), s.point_in_world.z());
    pixels.emplace_back(s.pixel.x(), s.pixel.y());
  }
  const cv::Matx33d matrix(camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1);
  cv::Mat rotation_vector, translation;
  cv::setRNGSeed(0);  // the generator belongs to the thread
  const bool found = cv::solvePnPRansac(
      points, pixels, matrix, cv::noArray(), rotation_vector, translation, false,
      options.iterations, static_cast<float>(options.max_error), options.confidence, result.inliers,
      options.minimal ? cv::SOLVEPNP_P3P : cv::SOLVEPNP_EPNP);
  if (!found) {
    result.inliers.clear();
    return result;
  }
  cv::Matx33d r;
  cv::Rodrigues(rotation_vector, r);
  Eigen::Matrix3d rotation;
  rotation << r(0, 0), r(0, 1), r(0, 2), r(1, 0), r(1, 1), r(1, 2), r(2, 0), r(2, 1), r(2, 2);
  result.cam_from_world = {Eigen::Quaterniond(rotation),
                           Eigen::Vector3d(translation.at<double>(0), translation.at<double>(1),
                                           translation.at<double>(2))};
  return result;
}

}  // namespace airslam
