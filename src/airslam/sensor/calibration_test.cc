// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/sensor/calibration.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "airslam/common/error.h"
#include "airslam/sensor/temporary_folder.h"

namespace airslam {
namespace {

using testing::AllOf;
using testing::HasSubstr;

std::string EurocCameraYaml(const std::string& tx, const std::string& model) {
  return "%YAML:1.0\n# a comment\nsensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n"
         "  data: [0.0, -1.0, 0.0, " +
         tx +
         ",\n         1.0, 0.0, 0.0, -0.06,\n"
         "         0.0, 0.0, 1.0, 0.01,\n         0.0, 0.0, 0.0, 1.0]\nrate_hz: 20\n"
         "resolution: [752, 480]\ncamera_model: pinhole\n"
         "intrinsics: [458.654, 457.296, 367.215, 248.375] #fu, fv, cu, cv\n"
         "distortion_model: " +
         model +
         "\n"
         "distortion_coefficients: [-0.28, 0.07, 0.0002, 1.8e-05]\n";
}

std::string EurocImuYaml(const std::string& tx) {
  return "%YAML:1.0\nsensor_type: imu\nT_BS:\n  cols: 4\n  rows: 4\n"
         "  data: [1, 0, 0, " +
         tx +
         ", 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\nrate_hz: 200\n"
         "gyroscope_noise_density: 1.7e-04 # [ rad / s / sqrt(Hz) ]\n"
         "gyroscope_random_walk: 1.9e-05\naccelerometer_noise_density: 2.0e-3\n"
         "accelerometer_random_walk: 3.0e-3\n";
}

const char kCamchain[] = R"(cam0:
  T_cam_imu:
  - [0.0, 1.0, 0.0, 0.1]
  - [-1.0, 0.0, 0.0, 0.2]
  - [0.0, 0.0, 1.0, 0.3]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [0.0034, 0.0007, -0.002, 0.0002]
  distortion_model: equidistant
  intrinsics: [190.9, 190.8, 254.9, 256.8]
  resolution: [512, 512]
  rostopic: /cam0/image_raw
  timeshift_cam_imu: 0.004
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.11]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [0.0034, 0.0007, -0.002, 0.0002]
  distortion_model: radtan
  intrinsics: [190.4, 190.5, 252.5, 255.0]
  resolution: [512, 512]
)";

const char kKalibrImu[] = R"(accelerometer_noise_density: 0.0028
accelerometer_random_walk: 0.00086
gyroscope_noise_density: 0.00016
gyroscope_random_walk: 2.2e-05
rostopic: /imu0
update_rate: 200.0
)";

std::string Replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

void WriteEuroc(const TemporaryFolder& folder) {
  folder.Write("cam0/sensor.yaml", EurocCameraYaml("-0.02", "radial-tangential"));
  folder.Write("cam1/sensor.yaml", EurocCameraYaml("0.08", "equidistant"));
  folder.Write("imu0/sensor.yaml", EurocImuYaml("0"));
}

TEST(ReadEurocRig, ReadsAllFieldsDespiteTheDirectiveOfOpenCv) {
  const TemporaryFolder folder;
  WriteEuroc(folder);
  const StereoRig rig = ReadEurocRig(folder.path());
  EXPECT_EQ(rig.left.camera.pinhole.fx, 458.654);
  EXPECT_EQ(rig.left.camera.pinhole.fy, 457.296);
  EXPECT_EQ(rig.left.camera.pinhole.cx, 367.215);
  EXPECT_EQ(rig.left.camera.pinhole.cy, 248.375);
  EXPECT_EQ(rig.left.camera.pinhole.width, 752);
  EXPECT_EQ(rig.left.camera.pinhole.height, 480);
  EXPECT_EQ(rig.left.camera.model, Distortion::kRadialTangential);
  EXPECT_EQ(rig.right.camera.model, Distortion::kEquidistant);
  EXPECT_EQ(rig.left.camera.coefficients[3], 1.8e-05);
  EXPECT_NEAR(rig.Baseline(), 0.1, 1e-12);
  EXPECT_EQ(rig.rate_hz, 20);
  // T_BS is body_from_cam: the camera's x axis is the body's y axis.
  EXPECT_LT((rig.left.body_from_cam * Eigen::Vector3d(1, 0, 0) - Eigen::Vector3d(-0.02, 0.94, 0.01))
                .norm(),
            1e-12);
  ASSERT_TRUE(rig.imu);
  EXPECT_EQ(rig.imu->gyroscope_noise_density, 1.7e-04);
  EXPECT_EQ(rig.imu->gyroscope_random_walk, 1.9e-05);
  EXPECT_EQ(rig.imu->accelerometer_noise_density, 2.0e-3);
  EXPECT_EQ(rig.imu->accelerometer_random_walk, 3.0e-3);
  EXPECT_EQ(rig.imu->rate_hz, 200);
}

TEST(ReadEurocRig, TakesTheImuAsBodyWhereverItStands) {
  const TemporaryFolder folder;
  WriteEuroc(folder);
  folder.Write("imu0/sensor.yaml", EurocImuYaml("0.5"));
  EXPECT_NEAR(ReadEurocRig(folder.path()).left.body_from_cam.translation.x(), -0.52, 1e-12);
}

TEST(ReadEurocRig, DoesWithoutAnImu) {
  const TemporaryFolder folder;
  WriteEuroc(folder);
  std::filesystem::remove(folder.path() / "imu0/sensor.yaml");
  EXPECT_FALSE(ReadEurocRig(folder.path()).imu);
}

TEST(ReadEurocRig, NamesFileAndFieldOfAnError) {
  struct Case {
    std::string from, to, expected;
  };
  const Case cases[] = {
      {"intrinsics:", "intrinsic:", "intrinsics is missing"},
      {"457.296, ", "", "intrinsics must hold 4 numbers, but holds 3"},
      {"457.296", "abc", "intrinsics holds something that is not a number"},
      {"458.654", "-458", "focal lengths in intrinsics must be positive"},
      {"752", "0", "resolution must be two numbers from 1 to 65535"},
      {"pinhole", "omni", "camera_model \"omni\" is not supported"},
      {"radial-tangential", "fov", "distortion_model \"fov\" is unknown"},
      {"0.0002, ", "", "distortion_coefficients must hold 4 numbers, but holds 3"},
      {"1.8e-05]", "1.8e-05, 0.5]", "distortion_coefficients must hold 4 numbers, but holds 5"},
      {"-1.0", "-0.5", "T_BS is not a rigid transform"},
      {"0.0, 1.0]\nrate", "1.0]\nrate", "data must hold 16 numbers, but holds 15"},
      {"camera_model: pinhole", "camera_model: [", "not valid YAML"},
  };
  for (const Case& c : cases) {
    const TemporaryFolder folder;
    WriteEuroc(folder);
    folder.Write("cam0/sensor.yaml",
                 Replaced(EurocCameraYaml("-0.02", "radial-tangential"), c.from, c.to));
    EXPECT_THAT(ErrorOf([&] { ReadEurocRig(folder.path()); }),
                AllOf(HasSubstr("cam0/sensor.yaml"), HasSubstr(c.expected)));
  }
}

TEST(ReadEurocRig, KeepsLineNumbersWhenTheDirectiveIsSkipped) {
  const TemporaryFolder folder;
  WriteEuroc(folder);
  folder.Write("cam1/sensor.yaml", "%YAML:1.0\nfine: 1\nbroken: [1, 2\nnext: 3\n");
  EXPECT_THAT(ErrorOf([&] { ReadEurocRig(folder.path()); }), HasSubstr("sensor.yaml:4:"));
}

TEST(ReadEurocRig, NamesAMissingFile) {
  const TemporaryFolder folder;
  WriteEuroc(folder);
  std::filesystem::remove(folder.path() / "cam1/sensor.yaml");
  EXPECT_THAT(ErrorOf([&] { ReadEurocRig(folder.path()); }),
              AllOf(HasSubstr("cam1/sensor.yaml"), HasSubstr("cannot be read")));
}

TEST(ReadKalibrRig, ReadsTheChainAndTheImu) {
  const TemporaryFolder folder;
  const StereoRig rig =
      ReadKalibrRig(folder.Write("camchain.yaml", kCamchain), folder.Write("imu.yaml", kKalibrImu));
  EXPECT_EQ(rig.left.camera.model, Distortion::kEquidistant);
  EXPECT_EQ(rig.right.camera.model, Distortion::kRadialTangential);
  EXPECT_EQ(rig.right.camera.pinhole.fx, 190.4);
  EXPECT_NEAR(rig.Baseline(), 0.11, 1e-12);
  EXPECT_EQ(rig.imu_time_offset, 0.004);
  // T_cam_imu is cam_from_imu: the IMU's origin is at (0.1, 0.2, 0.3) of the camera.
  EXPECT_LT((rig.left.body_from_cam * Eigen::Vector3d(0.1, 0.2, 0.3)).norm(), 1e-12);
  EXPECT_LT((rig.left.body_from_cam.rotation * Eigen::Vector3d(1, 0, 0) - Eigen::Vector3d(0, 1, 0))
                .norm(),
            1e-12);
  // The right camera's origin is at x = 0.11 of the left camera.
  const Eigen::Vector3d right = rig.left.body_from_cam * Eigen::Vector3d(0.11, 0, 0);
  EXPECT_LT((rig.right.body_from_cam.translation - right).norm(), 1e-12);
  ASSERT_TRUE(rig.imu);
  EXPECT_EQ(rig.imu->accelerometer_random_walk, 0.00086);
  EXPECT_EQ(rig.imu->rate_hz, 200);
}

TEST(ReadKalibrRig, TakesTheLeftCameraAsBodyWithoutAnImu) {
  const TemporaryFolder folder;
  const std::string chain = Replaced(kCamchain, "T_cam_imu", "T_unused");
  const auto file = folder.Write("camchain.yaml", chain);
  const StereoRig rig = ReadKalibrRig(file);
  EXPECT_FALSE(rig.imu);
  EXPECT_LT(rig.left.body_from_cam.translation.norm(), 1e-15);
  EXPECT_LT((rig.right.body_from_cam.translation - Eigen::Vector3d(0.11, 0, 0)).norm(), 1e-12);
  EXPECT_THAT(ErrorOf([&] { ReadKalibrRig(file, folder.Write("imu.yaml", kKalibrImu)); }),
              AllOf(HasSubstr("T_cam_imu is missing"), HasSubstr("cam0")));
}

TEST(ReadKalibrRig, NamesFileCameraAndField) {
  const TemporaryFolder folder;
  const auto without = folder.Write("a.yaml", Replaced(kCamchain, "T_cn_cnm1", "T_unused"));
  EXPECT_THAT(ErrorOf([&] { ReadKalibrRig(without); }),
              AllOf(HasSubstr("a.yaml (cam1)"), HasSubstr("T_cn_cnm1 is missing")));
  const auto mono = folder.Write("b.yaml", Replaced(kCamchain, "cam1:", "cam7:"));
  EXPECT_THAT(ErrorOf([&] { ReadKalibrRig(mono); }), HasSubstr("cam1 is missing"));
  const auto chain = folder.Write("c.yaml", kCamchain);
  const auto imu = folder.Write("d.yaml", Replaced(kKalibrImu, "update_rate: 200.0", "x: 1"));
  EXPECT_THAT(ErrorOf([&] { ReadKalibrRig(chain, imu); }),
              AllOf(HasSubstr("d.yaml"), HasSubstr("update_rate is missing")));
}

const char kKittiCalib[] =
    "P0: 718.856 0 607.1928 0 0 718.856 185.2157 0 0 0 1 0\n"
    "P1: 718.856 0 607.1928 -386.1448 0 718.856 185.2157 0 0 0 1 0\n"
    "P2: 1 2 3\n";

TEST(ReadCamera, ReadsAnEurocSensorAndAKalibrChain) {
  const TemporaryFolder folder;
  const auto euroc =
      ReadCamera(folder.Write("sensor.yaml", EurocCameraYaml("0.5", "radial-tangential")));
  EXPECT_EQ(euroc.camera.pinhole.fx, 458.654);
  EXPECT_EQ(euroc.camera.coefficients[0], -0.28);
  EXPECT_EQ(euroc.body_from_cam.translation.x(), 0.5);
  const auto kalibr = ReadCamera(folder.Write("camchain.yaml", kCamchain));
  EXPECT_EQ(kalibr.camera.model, Distortion::kEquidistant);
  EXPECT_EQ(kalibr.camera.pinhole.width, 512);
  // cam_from_imu of the chain takes the body's origin to (0.1, 0.2, 0.3).
  const Eigen::Vector3d origin = kalibr.body_from_cam.Inverse() * Eigen::Vector3d(0, 0, 0);
  EXPECT_TRUE(origin.isApprox(Eigen::Vector3d(0.1, 0.2, 0.3), 1e-9));
}

TEST(ReadCamera, WithoutAPoseTheCameraIsTheBody) {
  const TemporaryFolder folder;
  const auto camera = ReadCamera(folder.Write("camera.yaml",
                                              "resolution: [640, 480]\n"
                                              "intrinsics: [500, 501, 320, 240]\n"
                                              "distortion_model: none\n"));
  EXPECT_EQ(camera.camera.model, Distortion::kNone);
  EXPECT_EQ(camera.body_from_cam.translation.norm(), 0);
  const std::string file = folder.Write("bad.yaml", "resolution: [640, 480]\n");
  EXPECT_THAT(ErrorOf([&] { ReadCamera(file); }),
              AllOf(HasSubstr("bad.yaml"), HasSubstr("intrinsics")));
}

TEST(ReadKittiRig, TakesTheBaselineFromP1) {
  const TemporaryFolder folder;
  const StereoRig rig = ReadKittiRig(folder.Write("calib.txt", kKittiCalib), 1241, 376);
  EXPECT_TRUE(rig.already_rectified);
  EXPECT_EQ(rig.left.camera.pinhole.fx, 718.856);
  EXPECT_EQ(rig.left.camera.pinhole.cy, 185.2157);
  EXPECT_EQ(rig.left.camera.pinhole.width, 1241);
  EXPECT_NEAR(rig.right.body_from_cam.translation.x(), 386.1448 / 718.856, 1e-12);
  EXPECT_EQ(rig.left.camera.model, Distortion::kNone);
}

TEST(ReadKittiRig, NamesFileAndLine) {
  const TemporaryFolder folder;
  const auto read = [&](const std::string& text) {
    const auto file = folder.Write("calib.txt", text);
    return ErrorOf([&] { ReadKittiRig(file, 10, 10); });
  };
  EXPECT_THAT(read("P0: 1 2 3\n"), HasSubstr("calib.txt:1: expected 12 numbers after P0:"));
  EXPECT_THAT(read(Replaced(kKittiCalib, "P1:", "P9:")), HasSubstr("the line P1: is missing"));
  EXPECT_THAT(read(Replaced(kKittiCalib, "-386", "386")), HasSubstr("left of the left one"));
  EXPECT_THAT(read(Replaced(kKittiCalib, "718.856", "700")), HasSubstr("share one camera matrix"));
  EXPECT_THAT(ErrorOf([&] { ReadKittiRig(folder.path() / "none.txt", 10, 10); }),
              HasSubstr("none.txt cannot be read"));
}

}  // namespace
}  // namespace airslam
