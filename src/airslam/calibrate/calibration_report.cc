// SPDX-License-Identifier: BSD-3-Clause
//
// How a CalibrationReport reads.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <numbers>

#include "airslam/calibrate/calibration_check.h"

namespace airslam {
namespace {

constexpr double kDegrees = 180 / std::numbers::pi;

// Shares of |vertical disparity| below these, pixels.
constexpr std::array kBins = {0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0};

struct Bin {
  double below = 0;  // infinite: all the rest
  int matches = 0;
};

std::vector<Bin> Histogram(const std::vector<double>& pixels) {
  std::vector<Bin> bins;
  double last = 0;
  for (const double below : kBins) {
    const auto count = std::count_if(pixels.begin(), pixels.end(), [&](double e) {
      return std::abs(e) >= last && std::abs(e) < below;
    });
    bins.push_back({below, static_cast<int>(count)});
    last = below;
  }
  const auto rest =
      std::count_if(pixels.begin(), pixels.end(), [&](double e) { return std::abs(e) >= last; });
  bins.push_back({INFINITY, static_cast<int>(rest)});
  return bins;
}

using Text = fmt::memory_buffer;

template <typename... Args>
void Add(Text& text, fmt::format_string<Args...> format, Args&&... args) {
  fmt::format_to(std::back_inserter(text), format, std::forward<Args>(args)...);
}

void AddRig(Text& text, const CalibrationReport& report) {
  const RigDiagnosis& rig = report.rig;
  Add(text, "matches              {} in {} frames, {:.0f} % of them behind the cameras\n",
      rig.calibrated.size(), report.matches.frames.size(), 100 * rig.behind);
  Add(text,
      "vertical disparity   median {:.2f} px, 90 % below {:.2f} px (noise of a match {:.2f} px)\n",
      AbsoluteQuantile(rig.calibrated.pixels, 0.5), AbsoluteQuantile(rig.calibrated.pixels, 0.9),
      rig.noise);
  const std::vector<Bin> bins = Histogram(rig.calibrated.pixels);
  const int total = std::max(1, rig.calibrated.size());
  for (const Bin& bin : bins) {
    const std::string name = std::isinf(bin.below) ? fmt::format("{:>6} px", "more")
                                                   : fmt::format("<{:5.3g} px", bin.below);
    Add(text, "  {}  {:5.1f} %  {}\n", name, 100.0 * bin.matches / total,
        std::string(static_cast<std::size_t>(50 * bin.matches / total), '#'));
  }
  for (const RadiusRing& ring : rig.rings) {
    Add(text, "  up to {:4.0f} px from the centre: median {:.2f} px of {} matches\n",
        ring.max_radius, ring.median, ring.matches);
  }
  Add(text, "systematic error     {:.2f} px, {:.2f} px are allowed\n", rig.systematic, rig.allowed);
  const Eigen::Vector3d turn = kDegrees * rig.turned.correction.turn;
  const Eigen::Vector3d sigma = kDegrees * rig.turned.sigma.turn;
  Add(text,
      "rotation error       ({:+.3f}, {:+.3f}, {:+.3f}) degrees about x, y, z of the right camera "
      "(+- {:.3f}, {:.3f}, {:.3f})\n",
      turn.x(), turn.y(), turn.z(), sigma.x(), sigma.y(), sigma.z());
  if (rig.delayed.size() > 0 && rig.delayed.sigma.delay > 0) {
    Add(text, "right image          {:+.1f} ms after the left one (+- {:.1f})\n",
        1e3 * rig.delayed.correction.delay, 1e3 * rig.delayed.sigma.delay);
  }
  Add(text, "baseline             {:.4f} m as calibrated: images do not show its length\n",
      report.baseline);
}

void AddImu(Text& text, const CalibrationReport& report) {
  if (!report.has_imu) {
    Add(text, "IMU                  none\n");
    return;
  }
  const ImuCheck& imu = report.imu;
  if (!imu.unknown.empty()) {
    Add(text, "IMU                  not compared with the images: {}\n", imu.unknown);
  } else {
    if (imu.time_offset_sigma > 0) {
      Add(text,
          "IMU time offset      {:+.1f} ms found (+- {:.1f}), {:+.1f} ms calibrated (IMU minus "
          "image)\n",
          1e3 * (report.calibrated_time_offset + imu.time_offset), 1e3 * imu.time_offset_sigma,
          1e3 * report.calibrated_time_offset);
    } else {
      Add(text, "IMU time offset      the motion does not tell\n");
    }
    if (imu.rotation_sigma > 0) {
      Add(text, "camera on the IMU    {:.2f} degrees off (+- {:.2f})\n",
          kDegrees * imu.rotation.norm(), kDegrees * imu.rotation_sigma);
    } else {
      Add(text, "camera on the IMU    the motion does not tell\n");
    }
    Add(text, "turns                images / gyroscope = {:.4f} over {} turns\n", imu.turn_ratio,
        imu.turns);
  }
  const ImuNoise &measured = report.measured_noise, &calibrated = report.calibrated_noise;
  Add(text, "gyroscope noise      {:.2e} measured, {:.2e} calibrated, rad/s/sqrt(Hz)\n",
      measured.gyroscope_noise_density, calibrated.gyroscope_noise_density);
  Add(text, "accelerometer noise  {:.2e} measured, {:.2e} calibrated, m/s^2/sqrt(Hz)\n",
      measured.accelerometer_noise_density, calibrated.accelerometer_noise_density);
}

nlohmann::json RigJson(const RigDiagnosis& rig) {
  nlohmann::json histogram = nlohmann::json::array();
  for (const Bin& bin : Histogram(rig.calibrated.pixels)) {
    nlohmann::json below = nullptr;
    if (!std::isinf(bin.below)) below = bin.below;
    histogram.push_back({{"below_px", below}, {"matches", bin.matches}});
  }
  nlohmann::json rings = nlohmann::json::array();
  for (const RadiusRing& ring : rig.rings) {
    rings.push_back({{"max_radius_px", ring.max_radius},
                     {"median_px", ring.median},
                     {"matches", ring.matches}});
  }
  const auto degrees = [](const Eigen::Vector3d& v) {
    return nlohmann::json{kDegrees * v.x(), kDegrees * v.y(), kDegrees * v.z()};
  };
  return {{"vertical_disparity_px",
           {{"median", AbsoluteQuantile(rig.calibrated.pixels, 0.5)},
            {"p90", AbsoluteQuantile(rig.calibrated.pixels, 0.9)},
            {"histogram", histogram},
            {"rings", rings}}},
          {"match_noise_px", rig.noise},
          {"systematic_error_px", rig.systematic},
          {"allowed_systematic_error_px", rig.allowed},
          {"share_behind", rig.behind},
          {"rotation_error_deg", degrees(rig.turned.correction.turn)},
          {"rotation_error_sigma_deg", degrees(rig.turned.sigma.turn)},
          {"right_image_delay_s", rig.delayed.correction.delay},
          {"right_image_delay_sigma_s", rig.delayed.sigma.delay}};
}

nlohmann::json ImuJson(const CalibrationReport& report) {
  if (!report.has_imu) return nullptr;
  const ImuCheck& imu = report.imu;
  return {{"unknown", imu.unknown},
          {"turns", imu.turns},
          {"time_offset_s", report.calibrated_time_offset + imu.time_offset},
          {"time_offset_sigma_s", imu.time_offset_sigma},
          {"calibrated_time_offset_s", report.calibrated_time_offset},
          {"camera_rotation_error_deg", kDegrees * imu.rotation.norm()},
          {"camera_rotation_error_sigma_deg", kDegrees * imu.rotation_sigma},
          {"turn_ratio", imu.turn_ratio},
          {"gyroscope_noise_density",
           {{"measured", report.measured_noise.gyroscope_noise_density},
            {"calibrated", report.calibrated_noise.gyroscope_noise_density}}},
          {"accelerometer_noise_density",
           {{"measured", report.measured_noise.accelerometer_noise_density},
            {"calibrated", report.calibrated_noise.accelerometer_noise_density}}}};
}

}  // namespace

std::string FormatCalibrationReport(const CalibrationReport& report) {
  Text text;
  AddRig(text, report);
  AddImu(text, report);
  Add(text, "\n{}\n", report.sentence);
  return fmt::to_string(text);
}

nlohmann::json CalibrationReportToJson(const CalibrationReport& report) {
  nlohmann::json json = {{"right", report.right},
                         {"fault", report.fault},
                         {"sentence", report.sentence},
                         {"frames", report.matches.frames},
                         {"unreadable_frames", report.matches.unreadable},
                         {"matches", report.rig.calibrated.size()},
                         {"baseline_m", report.baseline},
                         {"rig", RigJson(report.rig)},
                         {"imu", ImuJson(report)}};
  return json;
}

}  // namespace airslam
