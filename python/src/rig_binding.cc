// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <nanobind/nanobind.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include "airslam/common/error.h"
#include "airslam/dataset/sequence.h"
#include "airslam/sensor/calibration.h"
#include "airslam/sensor/rectification.h"
#include "airslam/sensor/rig.h"
#include "src/arrays.h"
#include "src/bindings.h"

namespace airslam::python {
namespace {

namespace fs = std::filesystem;
using nb::literals::operator""_a;
using GivenPose = nb::ndarray<const double, nb::shape<4, 4>, nb::c_contig, nb::device::cpu>;

struct NamedModel {
  const char* name;
  Distortion model;
};
constexpr NamedModel kModels[] = {{"none", Distortion::kNone},
                                  {"radtan", Distortion::kRadialTangential},
                                  {"equidistant", Distortion::kEquidistant}};

Rigid3 PoseFrom(const GivenPose& given, const char* name) {
  const Eigen::Matrix4d matrix =
      Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(given.data());
  const Eigen::Matrix3d rotation = matrix.topLeftCorner<3, 3>();
  const bool is_rotation =
      (rotation * rotation.transpose()).isIdentity(1e-3) && rotation.determinant() > 0;
  if (!matrix.allFinite() || !is_rotation || matrix.row(3) != Eigen::RowVector4d(0, 0, 0, 1)) {
    Fail("{} is no rigid transform: expected [R t; 0 1] with a rotation R", name);
  }
  return Rigid3::FromMatrix(matrix);
}

RigCamera MakeCamera(const std::vector<double>& intrinsics, const std::tuple<int, int>& image_size,
                     const std::string& model, const std::vector<double>& distortion,
                     const std::optional<GivenPose>& body_from_camera) {
  RigCamera camera;
  Pinhole& pinhole = camera.camera.pinhole;
  if (intrinsics.size() != 4)
    Fail("intrinsics hold {} numbers: expected fx, fy, cx, cy", intrinsics.size());
  pinhole = {intrinsics[0], intrinsics[1],           intrinsics[2],
             intrinsics[3], std::get<0>(image_size), std::get<1>(image_size)};
  for (double x : intrinsics) {
    if (!std::isfinite(x)) Fail("intrinsics are not finite");
  }
  if (!(pinhole.fx > 0 && pinhole.fy > 0)) Fail("focal lengths must be above 0");
  if (pinhole.width < 1 || pinhole.height < 1) Fail("image_size must be (width, height) in pixels");
  const auto known = std::find_if(std::begin(kModels), std::end(kModels),
                                  [&](const NamedModel& m) { return m.name == model; });
  if (known == std::end(kModels))
    Fail("distortion model '{}' is unknown: expected none, radtan or equidistant", model);
  camera.camera.model = known->model;
  const std::size_t expected = known->model == Distortion::kNone ? 0 : 4;
  if (distortion.size() != expected) {
    Fail("distortion model {} has {} coefficients, not {}", model, expected, distortion.size());
  }
  std::copy(distortion.begin(), distortion.end(), camera.camera.coefficients.begin());
  if (body_from_camera) camera.body_from_cam = PoseFrom(*body_from_camera, "body_from_camera");
  return camera;
}

std::string ModelName(const RigCamera& camera) {
  for (const NamedModel& known : kModels) {
    if (known.model == camera.camera.model) return known.name;
  }
  return "unknown";
}

void BindCamera(nb::module_& module) {
  nb::class_<RigCamera>(module, "Camera", "A camera as calibrated, before rectification.")
      .def(
          "__init__",
          [](RigCamera* self, const std::vector<double>& intrinsics,
             const std::tuple<int, int>& image_size, const std::string& model,
             const std::vector<double>& distortion,
             const std::optional<GivenPose>& body_from_camera) {
            new (self)
                RigCamera(MakeCamera(intrinsics, image_size, model, distortion, body_from_camera));
          },
          "intrinsics"_a, "image_size"_a, "model"_a = "none",
          "distortion"_a = std::vector<double>{}, "body_from_camera"_a = nb::none(),
          "intrinsics: fx, fy, cx, cy in pixels. image_size: (width, height). model: 'none', "
          "'radtan' (k1 "
          "k2 p1 p2) or 'equidistant' (k1 k2 k3 k4). body_from_camera: 4x4, metres; the identity "
          "if not "
          "given. Raises Error.")
      .def_static("load", &ReadCamera, "file"_a, nb::call_guard<nb::gil_scoped_release>(),
                  "Reads an EuRoC sensor.yaml, or cam0 of a Kalibr camchain file. Raises Error.")
      .def_prop_ro(
          "intrinsics",
          [](const RigCamera& c) {
            const Pinhole& p = c.camera.pinhole;
            return std::tuple(p.fx, p.fy, p.cx, p.cy);
          },
          "fx, fy, cx, cy in pixels.")
      .def_prop_ro(
          "image_size",
          [](const RigCamera& c) {
            return std::tuple(c.camera.pinhole.width, c.camera.pinhole.height);
          },
          "(width, height) in pixels.")
      .def_prop_ro("model", &ModelName, "'none', 'radtan' or 'equidistant'.")
      .def_prop_ro(
          "distortion",
          [](const RigCamera& c) {
            const auto& k = c.camera.coefficients;
            return c.camera.model == Distortion::kNone ? std::vector<double>{}
                                                       : std::vector<double>(k.begin(), k.end());
          },
          "The model's coefficients.")
      .def_prop_ro(
          "body_from_camera", [](const RigCamera& c) { return ToArray(c.body_from_cam); },
          nb::rv_policy::automatic, "4x4: raw camera to body.");
}

ImuNoise MakeNoise(double gyroscope_noise, double gyroscope_walk, double accelerometer_noise,
                   double accelerometer_walk, double rate_hz) {
  for (double x :
       {gyroscope_noise, gyroscope_walk, accelerometer_noise, accelerometer_walk, rate_hz}) {
    if (!(x > 0 && std::isfinite(x))) Fail("the IMU's noise figures and its rate must be above 0");
  }
  return {gyroscope_noise, gyroscope_walk, accelerometer_noise, accelerometer_walk, rate_hz};
}

void BindNoise(nb::module_& module) {
  nb::class_<ImuNoise>(module, "ImuNoise", "Noise of an IMU, as in EuRoC's and Kalibr's files.")
      .def(
          "__init__",
          [](ImuNoise* self, double gyroscope_noise, double gyroscope_walk,
             double accelerometer_noise, double accelerometer_walk, double rate_hz) {
            new (self) ImuNoise(MakeNoise(gyroscope_noise, gyroscope_walk, accelerometer_noise,
                                          accelerometer_walk, rate_hz));
          },
          nb::kw_only(), "gyroscope_noise_density"_a, "gyroscope_random_walk"_a,
          "accelerometer_noise_density"_a, "accelerometer_random_walk"_a, "rate_hz"_a,
          "rad/s/sqrt(Hz), rad/s^2/sqrt(Hz), m/s^2/sqrt(Hz), m/s^3/sqrt(Hz), readings a second. "
          "Raises Error.")
      .def_ro("gyroscope_noise_density", &ImuNoise::gyroscope_noise_density, "rad/s/sqrt(Hz)")
      .def_ro("gyroscope_random_walk", &ImuNoise::gyroscope_random_walk, "rad/s^2/sqrt(Hz)")
      .def_ro("accelerometer_noise_density", &ImuNoise::accelerometer_noise_density,
              "m/s^2/sqrt(Hz)")
      .def_ro("accelerometer_random_walk", &ImuNoise::accelerometer_random_walk, "m/s^3/sqrt(Hz)")
      .def_ro("rate_hz", &ImuNoise::rate_hz, "Readings a second.");
}

StereoRig MakeRig(const RigCamera& left, const RigCamera& right, const std::optional<ImuNoise>& imu,
                  double imu_time_offset, bool already_rectified) {
  StereoRig rig;
  rig.left = left;
  rig.right = right;
  rig.imu = imu;
  rig.imu_time_offset = imu_time_offset;
  rig.already_rectified = already_rectified;
  StereoRectifier{rig};  // says now what is wrong with it
  return rig;
}

}  // namespace

void BindRig(nb::module_& module) {
  BindCamera(module);
  BindNoise(module);
  nb::class_<StereoRig>(module, "StereoRig",
                        "The calibration of two cameras and, if there is one, an IMU.")
      .def(
          "__init__",
          [](StereoRig* self, const RigCamera& left, const RigCamera& right,
             const std::optional<ImuNoise>& imu, double imu_time_offset, bool already_rectified) {
            new (self) StereoRig(MakeRig(left, right, imu, imu_time_offset, already_rectified));
          },
          "left"_a, "right"_a, nb::kw_only(), "imu"_a = nb::none(), "imu_time_offset"_a = 0.0,
          "already_rectified"_a = false,
          "The body is the IMU if there is one: body_from_camera of both cameras refer to it. "
          "imu_time_offset: seconds, time of the IMU = time of the image + this. "
          "already_rectified: the "
          "images share one pinhole camera and their rows correspond. Raises Error when the rig "
          "cannot be "
          "rectified.")
      .def_static(
          "load",
          [](const fs::path& dataset) {
            nb::gil_scoped_release release;
            return StereoRig(OpenSequence(dataset)->rig());
          },
          "dataset"_a, "The rig of an EuRoC ASL or KITTI odometry folder. Raises Error.")
      .def_static("load_kalibr", &ReadKalibrRig, "camchain"_a, "imu"_a = fs::path(),
                  nb::call_guard<nb::gil_scoped_release>(),
                  "Reads Kalibr's camchain file and, if it is given, its IMU file. Raises Error.")
      .def_ro("left", &StereoRig::left, "The left camera.")
      .def_ro("right", &StereoRig::right, "The right camera.")
      .def_ro("imu", &StereoRig::imu, "Noise of the IMU, or None.")
      .def_ro("imu_time_offset", &StereoRig::imu_time_offset,
              "Seconds: time of the IMU = time of the image + this.")
      .def_prop_ro("baseline", &StereoRig::Baseline, "Metres between the optical centres.");
}

}  // namespace airslam::python
