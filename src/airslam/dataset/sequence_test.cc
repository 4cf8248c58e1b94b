// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/dataset/sequence.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "airslam/common/error.h"
#include "airslam/sensor/temporary_folder.h"

namespace airslam {
namespace {

using testing::AllOf;
using testing::Contains;
using testing::HasSubstr;
using testing::IsEmpty;

namespace fs = std::filesystem;

constexpr std::int64_t kStart = 1403715273262142976;
constexpr std::int64_t kPeriod = 50'000'000;

std::string SensorYaml(double x) {
  return fmt::format(
      "%YAML:1.0\nT_BS:\n  cols: 4\n  rows: 4\n"
      "  data: [1, 0, 0, {}, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\nrate_hz: 20\n"
      "resolution: [32, 24]\ncamera_model: pinhole\nintrinsics: [30, 30, 15.5, 11.5]\n"
      "distortion_model: radial-tangential\ndistortion_coefficients: [0, 0, 0, 0]\n",
      x);
}

const char kImuYaml[] =
    "%YAML:1.0\nT_BS:\n  data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\nrate_hz: 200\n"
    "gyroscope_noise_density: 1e-4\ngyroscope_random_walk: 1e-5\n"
    "accelerometer_noise_density: 1e-3\naccelerometer_random_walk: 1e-3\n";

// A small folder in the EuRoC layout, to be damaged by each test in its own way.
class EurocFolder : public testing::Test {
 protected:
  EurocFolder() {
    folder_.Write("mav0/cam0/sensor.yaml", SensorYaml(0));
    folder_.Write("mav0/cam1/sensor.yaml", SensorYaml(0.1));
    for (int i = 0; i < 6; ++i) {
      times_.push_back(kStart + i * kPeriod);
      AddImage("cam0", times_[i], 10 + i);
      AddImage("cam1", times_[i], 100 + i);
    }
    WriteCsv("cam0", times_);
    WriteCsv("cam1", times_);
  }

  const fs::path& path() const { return folder_.path(); }

  void AddImage(const std::string& camera, std::int64_t time, int grey) {
    WriteImage(fmt::format("mav0/{}/data/{}.png", camera, time),
               cv::Mat(24, 32, CV_8UC1, cv::Scalar(grey)));
  }

  void WriteImage(const fs::path& name, const cv::Mat& image) {
    fs::create_directories((path() / name).parent_path());
    ASSERT_TRUE(cv::imwrite((path() / name).string(), image));
  }

  void WriteCsv(const std::string& camera, const std::vector<std::int64_t>& times) {
    std::string text = "#timestamp [ns],filename\n";
    for (const std::int64_t time : times) text += fmt::format("{},{}.png\r\n", time, time);
    folder_.Write("mav0/" + camera + "/data.csv", text);
  }

  void WriteImu(const std::vector<std::int64_t>& times) {
    std::string text = "#timestamp [ns],w_x,w_y,w_z,a_x,a_y,a_z\n";
    for (std::size_t i = 0; i < times.size(); ++i) {
      text += fmt::format("{},0.1,0.2,0.3,{},2,9.8\n", times[i], i);
    }
    folder_.Write("mav0/imu0/data.csv", text);
    folder_.Write("mav0/imu0/sensor.yaml", kImuYaml);
  }

  std::string OpenError() const {
    return ErrorOf([&] { OpenSequence(path()); });
  }

  TemporaryFolder folder_;
  std::vector<std::int64_t> times_;
};

TEST_F(EurocFolder, OpensAndReads) {
  for (const fs::path& opened : {path(), path() / "mav0"}) {
    const auto sequence = OpenSequence(opened);
    EXPECT_EQ(sequence->name(), "EuRoC");
    ASSERT_EQ(sequence->size(), 6);
    EXPECT_EQ(sequence->timestamp_ns(2), kStart + 2 * kPeriod);
    EXPECT_NEAR(sequence->rig().Baseline(), 0.1, 1e-12);
    EXPECT_THAT(sequence->warnings(), IsEmpty());
    EXPECT_THAT(sequence->imu(), IsEmpty());
    const StereoPair pair = sequence->Read(2);
    EXPECT_EQ(pair.timestamp_ns, kStart + 2 * kPeriod);
    EXPECT_EQ(pair.left.at<uchar>(5, 5), 12);
    EXPECT_EQ(pair.right.at<uchar>(5, 5), 102);
  }
}

TEST_F(EurocFolder, DropsUnpairedImagesWithAWarning) {
  // The right camera misses one image, has one between two, and runs 4 ms late.
  WriteCsv("cam1",
           {times_[0] + 4'000'000, times_[1], times_[2] + 20'000'000, times_[4], times_[5]});
  AddImage("cam1", times_[0] + 4'000'000, 100);
  const auto sequence = OpenSequence(path());
  EXPECT_EQ(sequence->size(), 4);
  EXPECT_EQ(sequence->timestamp_ns(2), times_[4]);
  EXPECT_EQ(sequence->Read(2).right.at<uchar>(0, 0), 104);
  EXPECT_THAT(sequence->warnings(),
              testing::ElementsAre(HasSubstr(
                  "2 left and 1 right images have no partner within 5.000 ms and are dropped")));
}

TEST_F(EurocFolder, RefusesPairsThatAreNeverSynchronised) {
  std::vector<std::int64_t> late;
  for (const std::int64_t time : times_) late.push_back(time + 17'000'000);
  WriteCsv("cam1", late);
  EXPECT_THAT(OpenError(), AllOf(HasSubstr("never taken at the same time"),
                                 HasSubstr("17.000 ms apart, 5.000 ms are allowed")));
}

TEST_F(EurocFolder, NamesTheLineWhereTimeGoesBack) {
  std::swap(times_[3], times_[4]);
  WriteCsv("cam0", times_);
  EXPECT_THAT(OpenError(), HasSubstr(fmt::format("cam0/data.csv:6: the time {}", times_[4])));
}

TEST_F(EurocFolder, NamesABadLine) {
  folder_.Write("mav0/cam1/data.csv", "#t,f\n1403715273262142976,a.png\n14037x,b.png\n");
  EXPECT_THAT(OpenError(), HasSubstr("cam1/data.csv:3: expected a time in nanoseconds"));
  folder_.Write("mav0/cam1/data.csv", "#t,f\n1403715273262142976\n");
  EXPECT_THAT(OpenError(), HasSubstr("cam1/data.csv:2: expected a time in nanoseconds"));
  folder_.Write("mav0/cam1/data.csv", "#t,f\n");
  EXPECT_THAT(OpenError(), HasSubstr("cam1/data.csv lists no image"));
}

TEST_F(EurocFolder, TakesNamesForTimesWithoutCsv) {
  fs::remove(path() / "mav0/cam0/data.csv");
  const auto sequence = OpenSequence(path());
  EXPECT_EQ(sequence->size(), 6);
  EXPECT_EQ(sequence->timestamp_ns(5), times_[5]);
  EXPECT_THAT(sequence->warnings(), Contains(HasSubstr("cam0/data.csv is missing")));
  fs::remove_all(path() / "mav0/cam0/data");
  EXPECT_THAT(OpenError(), HasSubstr("cam0/data.csv is missing, and no image in"));
  fs::remove_all(path() / "mav0/cam1");
  EXPECT_THAT(OpenError(), HasSubstr("cam0/data.csv is missing"));
}

TEST_F(EurocFolder, NamesAMissingCamera) {
  fs::remove_all(path() / "mav0/cam1");
  EXPECT_THAT(OpenError(), HasSubstr("mav0/cam1 is missing"));
}

TEST_F(EurocFolder, OneBrokenFrameIsTheCallersToSkip) {
  fs::remove(path() / fmt::format("mav0/cam0/data/{}.png", times_[0]));
  folder_.Write(fmt::format("mav0/cam1/data/{}.png", times_[3]), "broken");
  WriteImage(fmt::format("mav0/cam0/data/{}.png", times_[4]), cv::Mat::zeros(24, 30, CV_8UC1));
  const auto sequence = OpenSequence(path());
  EXPECT_THAT(ErrorOf([&] { sequence->Read(0); }), HasSubstr("is missing"));
  EXPECT_THAT(ErrorOf([&] { sequence->Read(3); }), HasSubstr("cannot be decoded"));
  EXPECT_THAT(ErrorOf([&] { sequence->Read(4); }), HasSubstr("30x24 pixels"));
  EXPECT_EQ(ErrorOf([&] { sequence->Read(5); }), "");
}

TEST_F(EurocFolder, RefusesImagesThatAreAllMissing) {
  fs::remove_all(path() / "mav0/cam1/data");
  EXPECT_THAT(OpenError(), AllOf(HasSubstr("none of the first 5 image pairs can be read"),
                                 HasSubstr(".png is missing")));
}

TEST_F(EurocFolder, RefusesACalibrationOfAnotherSize) {
  WriteImage(fmt::format("mav0/cam1/data/{}.png", times_[0]), cv::Mat::zeros(24, 30, CV_8UC1));
  EXPECT_THAT(OpenError(), AllOf(HasSubstr("cam1/data"),
                                 HasSubstr("30x24 pixels, but the calibration says 32x24")));
}

TEST_F(EurocFolder, ReadsColourAndScalesSixteenBitsByWhatTheSequenceHolds) {
  WriteImage(fmt::format("mav0/cam0/data/{}.png", times_[1]),
             cv::Mat(24, 32, CV_8UC3, cv::Scalar(50, 50, 50)));
  EXPECT_EQ(OpenSequence(path())->Read(1).left.at<uchar>(0, 0), 50);

  for (int i = 0; i < 6; ++i) {
    for (const char* camera : {"cam0", "cam1"}) {
      WriteImage(fmt::format("mav0/{}/data/{}.png", camera, times_[i]),
                 cv::Mat(24, 32, CV_16UC1, cv::Scalar(1600 + 16 * i)));
    }
  }
  EXPECT_EQ(OpenSequence(path())->Read(1).left.at<uchar>(0, 0), 101);  // 12 bits: >> 4
  WriteImage(fmt::format("mav0/cam0/data/{}.png", times_[5]),
             cv::Mat(24, 32, CV_16UC1, cv::Scalar(60000)));
  EXPECT_EQ(OpenSequence(path())->Read(1).left.at<uchar>(0, 0), 6);  // 16 bits: >> 8
}

TEST_F(EurocFolder, ReadsTheImu) {
  std::vector<std::int64_t> times;
  for (int i = 0; i <= 50; ++i) times.push_back(kStart + i * 5'000'000);
  WriteImu(times);
  const auto sequence = OpenSequence(path());
  ASSERT_EQ(sequence->imu().size(), 51u);
  EXPECT_EQ(sequence->imu()[3].timestamp_ns, times[3]);
  EXPECT_EQ(sequence->imu()[3].angular_velocity, Eigen::Vector3d(0.1, 0.2, 0.3));
  EXPECT_EQ(sequence->imu()[3].acceleration, Eigen::Vector3d(3, 2, 9.8));
  EXPECT_THAT(sequence->warnings(), IsEmpty());
}

TEST_F(EurocFolder, DropsImuSamplesThatRepeatOrGoBack) {
  std::vector<std::int64_t> times;
  for (int i = 0; i <= 50; ++i) times.push_back(kStart + i * 5'000'000);
  times[10] = times[9];
  times[20] = times[15];
  times[21] = times[16];
  WriteImu(times);
  const auto sequence = OpenSequence(path());
  EXPECT_EQ(sequence->imu().size(), 48u);
  EXPECT_THAT(sequence->warnings(), Contains(HasSubstr("1 samples repeat the time")));
  EXPECT_THAT(sequence->warnings(), Contains(HasSubstr("2 samples go back in time")));
}

TEST_F(EurocFolder, WarnsOfGapsInTheImu) {
  WriteImu({kStart, kStart + 5'000'000, kStart + 100'000'000});
  const auto sequence = OpenSequence(path());
  EXPECT_THAT(sequence->warnings(), Contains(HasSubstr("do not cover the time of all images")));
  EXPECT_THAT(sequence->warnings(), Contains(HasSubstr("1 gaps, the longest of 0.095 s")));
}

TEST_F(EurocFolder, NamesABadImuLine) {
  WriteImu({kStart});
  folder_.Write("mav0/imu0/data.csv", "#t\n1403715273262142976,0,0,0,0,0\n");
  EXPECT_THAT(OpenError(), HasSubstr("imu0/data.csv:2: expected a time in nanoseconds and 6"));
  folder_.Write("mav0/imu0/data.csv", "#t\n1403715273262142976,0,0,0,0,0,x\n");
  EXPECT_THAT(OpenError(), HasSubstr("imu0/data.csv:2: \"x\" is not a number"));
}

TEST_F(EurocFolder, FallsBackToKalibrsCalibration) {
  fs::remove(path() / "mav0/cam0/sensor.yaml");
  EXPECT_THAT(OpenError(), AllOf(HasSubstr("no calibration found"), HasSubstr("camchain")));
  const char camera[] =
      "  camera_model: pinhole\n  distortion_coeffs: [0, 0, 0, 0]\n  distortion_model: radtan\n"
      "  intrinsics: [31, 30, 15.5, 11.5]\n  resolution: [32, 24]\n";
  folder_.Write("camchain-imucam.yaml",
                fmt::format("cam0:\n{}cam1:\n{}  T_cn_cnm1: [[1, 0, 0, -0.2], [0, 1, 0, 0], "
                            "[0, 0, 1, 0], [0, 0, 0, 1]]\n",
                            camera, camera));
  const auto sequence = OpenSequence(path());
  EXPECT_NEAR(sequence->rig().Baseline(), 0.2, 1e-12);
  EXPECT_EQ(sequence->rig().left.camera.pinhole.fx, 31);
}

// A small folder in the KITTI layout.
class KittiFolder : public testing::Test {
 protected:
  KittiFolder() {
    folder_.Write("calib.txt",
                  "P0: 30 0 15.5 0 0 30 11.5 0 0 0 1 0\nP1: 30 0 15.5 -15 0 30 11.5 0 0 0 1 0\n");
    folder_.Write("times.txt", "0.000000e+00\n1.037359e-01\n2.073381e-01\n");
    for (int i = 0; i < 3; ++i) {
      AddImage(fmt::format("image_0/{:06}.png", i), 10 + i);
      AddImage(fmt::format("image_1/{:06}.jpg", i), 100 + i);
    }
  }

  const fs::path& path() const { return folder_.path(); }

  void AddImage(const std::string& name, int grey) {
    fs::create_directories((path() / name).parent_path());
    ASSERT_TRUE(cv::imwrite((path() / name).string(), cv::Mat(24, 32, CV_8UC1, cv::Scalar(grey))));
  }

  std::string OpenError() const {
    return ErrorOf([&] { OpenSequence(path()); });
  }

  TemporaryFolder folder_;
};

TEST_F(KittiFolder, OpensAndReads) {
  const auto sequence = OpenSequence(path());
  EXPECT_EQ(sequence->name(), "KITTI");
  ASSERT_EQ(sequence->size(), 3);
  EXPECT_EQ(sequence->timestamp_ns(1), 103735900);
  EXPECT_NEAR(sequence->rig().Baseline(), 0.5, 1e-12);
  EXPECT_EQ(sequence->rig().left.camera.pinhole.width, 32);
  EXPECT_NEAR(sequence->rig().rate_hz, 2 / 0.2073381, 1e-6);
  EXPECT_TRUE(sequence->rig().already_rectified);
  EXPECT_THAT(sequence->warnings(), IsEmpty());
  EXPECT_EQ(sequence->Read(2).left.at<uchar>(3, 3), 12);
  EXPECT_NEAR(sequence->Read(2).right.at<uchar>(3, 3), 102, 1);
}

TEST_F(KittiFolder, NamesWhatDoesNotMatch) {
  fs::remove(path() / "image_1/000001.jpg");
  EXPECT_THAT(OpenError(), HasSubstr("image_0 holds 3 images, but image_1 beside it holds 2"));
  AddImage("image_1/000007.jpg", 0);
  EXPECT_THAT(OpenError(), HasSubstr("image_0/000001.png has no partner in image_1"));
  AddImage("image_0/000007.png", 0);
  AddImage("image_1/000001.jpg", 0);
  EXPECT_THAT(OpenError(), HasSubstr("times.txt has only 3 lines, but there is an image"));
}

TEST_F(KittiFolder, NamesABadTime) {
  folder_.Write("times.txt", "0.0\n0.2\n0.1\n");
  EXPECT_THAT(OpenError(), HasSubstr("times.txt:3: the time 0.1 is not later"));
  folder_.Write("times.txt", "0.0\n0.2s\n0.4\n");
  EXPECT_THAT(OpenError(), HasSubstr("times.txt:2: \"0.2s\" is not a time in seconds"));
}

TEST_F(KittiFolder, NamesMissingParts) {
  fs::remove(path() / "times.txt");
  EXPECT_THAT(OpenError(), HasSubstr("times.txt cannot be read"));
  folder_.Write("times.txt", "0.0\n0.1\n0.2\n0.3\n");
  EXPECT_THAT(OpenSequence(path())->warnings(),
              Contains(HasSubstr("lists 4 times, but there are only 3 image pairs")));
  fs::remove(path() / "calib.txt");
  EXPECT_THAT(OpenError(), HasSubstr("calib.txt cannot be read"));
  fs::remove_all(path() / "image_1");
  EXPECT_THAT(OpenError(), HasSubstr("image_1 is missing"));
  fs::create_directories(path() / "image_1");
  EXPECT_THAT(OpenError(), HasSubstr("image_1 holds no image"));
}

TEST_F(KittiFolder, RefusesRightImagesOfAnotherSize) {
  cv::imwrite((path() / "image_1/000000.jpg").string(), cv::Mat::zeros(20, 32, CV_8UC1));
  EXPECT_THAT(OpenError(), HasSubstr("32x20 pixels, but the calibration says 32x24"));
}

TEST(OpenSequence, SaysWhatItLooksFor) {
  const TemporaryFolder folder;
  EXPECT_THAT(ErrorOf([&] { OpenSequence(folder.path()); }), HasSubstr("is empty"));
  EXPECT_THAT(ErrorOf([&] { OpenSequence(folder.path() / "none"); }), HasSubstr("does not exist"));
  const auto file = folder.Write("readme.txt", "x");
  EXPECT_THAT(ErrorOf([&] { OpenSequence(file); }), HasSubstr("is not a folder"));
  EXPECT_THAT(ErrorOf([&] { OpenSequence(folder.path()); }),
              AllOf(HasSubstr("EuRoC"), HasSubstr("mav0"), HasSubstr("KITTI")));
}

}  // namespace
}  // namespace airslam
