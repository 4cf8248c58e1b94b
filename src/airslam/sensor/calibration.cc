// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/sensor/calibration.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "airslam/common/error.h"
#include "airslam/sensor/yaml_fields.h"

namespace airslam {
namespace {

namespace fs = std::filesystem;

Distortion ParseDistortionModel(const YamlFields& fields) {
  const std::string name = fields.Text("distortion_model");
  if (name == "radial-tangential" || name == "radtan" || name == "plumb_bob") {
    return Distortion::kRadialTangential;
  }
  if (name == "equidistant") return Distortion::kEquidistant;
  if (name == "none") return Distortion::kNone;
  Fail(
      "{}: distortion_model \"{}\" is unknown, expected radial-tangential (radtan), equidistant or "
      "none",
      fields.where(), name);
}

// The coefficients below `field`; a fifth one (k3) is not supported unless it is zero.
std::array<double, 4> ParseCoefficients(const YamlFields& fields, const std::string& field,
                                        Distortion model) {
  std::array<double, 4> coefficients = {0, 0, 0, 0};
  if (model == Distortion::kNone) return coefficients;
  const std::vector<double> numbers = fields.Numbers(field, -1);
  const bool zero_k3 = numbers.size() == 5 && numbers[4] == 0;
  if (numbers.size() != 4 && !zero_k3) {
    Fail("{}: the field {} must hold 4 numbers, but holds {}", fields.where(), field,
         numbers.size());
  }
  std::copy_n(numbers.begin(), 4, coefficients.begin());
  return coefficients;
}

// The part that EuRoC and Kalibr share; only the name of the coefficients differs.
DistortedCamera ParseCamera(const YamlFields& fields, const std::string& coefficients_field) {
  if (fields.Has("camera_model") && fields.Text("camera_model") != "pinhole") {
    Fail("{}: camera_model \"{}\" is not supported, expected pinhole", fields.where(),
         fields.Text("camera_model"));
  }
  constexpr double kMaxSide = 65'535;  // pixels
  DistortedCamera camera;
  const std::vector<double> intrinsics = fields.Numbers("intrinsics", 4);
  const std::vector<double> resolution = fields.Numbers("resolution", 2);
  for (const double side : resolution) {
    if (!(side >= 1 && side <= kMaxSide)) {
      Fail("{}: the resolution must be two numbers from 1 to {:.0f}", fields.where(), kMaxSide);
    }
  }
  camera.pinhole = {intrinsics[0],
                    intrinsics[1],
                    intrinsics[2],
                    intrinsics[3],
                    static_cast<int>(resolution[0]),
                    static_cast<int>(resolution[1])};
  if (camera.pinhole.fx <= 0 || camera.pinhole.fy <= 0) {
    Fail("{}: the focal lengths in intrinsics must be positive", fields.where());
  }
  camera.model = ParseDistortionModel(fields);
  camera.coefficients = ParseCoefficients(fields, coefficients_field, camera.model);
  return camera;
}

ImuNoise ParseImuNoise(const YamlFields& fields, const std::string& rate_field) {
  ImuNoise noise;
  noise.gyroscope_noise_density = fields.Number("gyroscope_noise_density");
  noise.gyroscope_random_walk = fields.Number("gyroscope_random_walk");
  noise.accelerometer_noise_density = fields.Number("accelerometer_noise_density");
  noise.accelerometer_random_walk = fields.Number("accelerometer_random_walk");
  noise.rate_hz = fields.Number(rate_field);
  for (const double value :
       {noise.gyroscope_noise_density, noise.gyroscope_random_walk,
        noise.accelerometer_noise_density, noise.accelerometer_random_walk, noise.rate_hz}) {
    if (value <= 0) Fail("{}: the noise densities and the rate must be positive", fields.where());
  }
  return noise;
}

// KITTI's lines "P0: 12 numbers", row by row.
std::map<std::string, std::array<double, 12>> ReadKittiMatrices(const fs::path& file) {
  std::ifstream stream(file);
  if (!stream) Fail("the calibration file {} cannot be read", file.string());
  std::map<std::string, std::array<double, 12>> matrices;
  std::string line;
  for (int number = 1; std::getline(stream, line); ++number) {
    std::istringstream words(line);
    std::string name;
    if (!(words >> name)) continue;
    if (name != "P0:" && name != "P1:") continue;
    std::array<double, 12> matrix;
    for (double& value : matrix) {
      if (!(words >> value) || !std::isfinite(value)) {
        Fail("{}:{}: expected 12 numbers after {}", file.string(), number, name);
      }
    }
    matrices[name] = matrix;
  }
  for (const char* name : {"P0:", "P1:"}) {
    if (!matrices.contains(name)) Fail("{}: the line {} is missing", file.string(), name);
  }
  return matrices;
}

}  // namespace

StereoRig ReadEurocRig(const fs::path& mav0) {
  const YamlFields left = YamlFields::Load(mav0 / "cam0" / "sensor.yaml");
  const YamlFields right = YamlFields::Load(mav0 / "cam1" / "sensor.yaml");
  StereoRig rig;
  rig.left = {ParseCamera(left, "distortion_coefficients"), left.Transform("T_BS")};
  rig.right = {ParseCamera(right, "distortion_coefficients"), right.Transform("T_BS")};
  rig.rate_hz = left.NumberOr("rate_hz", 0);
  const fs::path imu_yaml = mav0 / "imu0" / "sensor.yaml";
  if (fs::exists(imu_yaml)) {
    const YamlFields imu = YamlFields::Load(imu_yaml);
    rig.imu = ParseImuNoise(imu, "rate_hz");
    const Rigid3 imu_from_base = imu.Transform("T_BS").Inverse();
    rig.left.body_from_cam = imu_from_base * rig.left.body_from_cam;
    rig.right.body_from_cam = imu_from_base * rig.right.body_from_cam;
  }
  return rig;
}

StereoRig ReadKalibrRig(const fs::path& camchain_yaml, const fs::path& imu_yaml) {
  const YamlFields chain = YamlFields::Load(camchain_yaml);
  const YamlFields left = chain.Sub("cam0");
  const YamlFields right = chain.Sub("cam1");
  StereoRig rig;
  rig.left.camera = ParseCamera(left, "distortion_coeffs");
  rig.right.camera = ParseCamera(right, "distortion_coeffs");
  const bool has_imu_pose = left.Has("T_cam_imu");
  if (has_imu_pose) rig.left.body_from_cam = left.Transform("T_cam_imu").Inverse();
  if (has_imu_pose && right.Has("T_cam_imu")) {
    rig.right.body_from_cam = right.Transform("T_cam_imu").Inverse();
  } else {
    rig.right.body_from_cam = rig.left.body_from_cam * right.Transform("T_cn_cnm1").Inverse();
  }
  rig.imu_time_offset = left.NumberOr("timeshift_cam_imu", 0);
  if (!imu_yaml.empty()) {
    if (!has_imu_pose) {
      Fail("{}: the field T_cam_imu is missing, without it the IMU of {} cannot be used",
           left.where(), imu_yaml.string());
    }
    const YamlFields imu = YamlFields::Load(imu_yaml);
    rig.imu = ParseImuNoise(imu.Has("imu0") ? imu.Sub("imu0") : imu, "update_rate");
  }
  return rig;
}

RigCamera ReadCamera(const fs::path& yaml) {
  const YamlFields file = YamlFields::Load(yaml);
  if (file.Has("cam0")) {
    const YamlFields fields = file.Sub("cam0");
    RigCamera camera{ParseCamera(fields, "distortion_coeffs"), {}};
    if (fields.Has("T_cam_imu")) camera.body_from_cam = fields.Transform("T_cam_imu").Inverse();
    return camera;
  }
  RigCamera camera{ParseCamera(file, "distortion_coefficients"), {}};
  if (file.Has("T_BS")) camera.body_from_cam = file.Transform("T_BS");
  return camera;
}

StereoRig ReadKittiRig(const fs::path& calib_txt, int width, int height) {
  const auto matrices = ReadKittiMatrices(calib_txt);
  const auto& p0 = matrices.at("P0:");
  const auto& p1 = matrices.at("P1:");
  for (const int i : {0, 2, 5, 6}) {
    if (p0[i] != p1[i]) {
      Fail("{}: P0 and P1 must share one camera matrix, as rectified images do",
           calib_txt.string());
    }
  }
  if (p0[0] <= 0 || p0[5] <= 0) {
    Fail("{}: the focal lengths in P0 must be positive", calib_txt.string());
  }
  const double baseline = (p0[3] - p1[3]) / p0[0];
  if (baseline <= 0) {
    Fail(
        "{}: swapped cameras or an inverted extrinsic: P1 puts the right camera left of the left "
        "one "
        "(baseline {:.3f} m)",
        calib_txt.string(), baseline);
  }
  StereoRig rig;
  rig.left.camera.pinhole = {p0[0], p0[5], p0[2], p0[6], width, height};
  rig.right.camera = rig.left.camera;
  rig.right.body_from_cam.translation.x() = baseline;
  rig.already_rectified = true;
  return rig;
}

}  // namespace airslam
