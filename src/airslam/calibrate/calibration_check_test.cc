// SPDX-License-Identifier: BSD-3-Clause
//
// A good calibration, broken in each of the ways that check-calib knows.
#include "airslam/calibrate/calibration_check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "airslam/calibrate/epipolar_picture.h"
#include "airslam/calibrate/test_sequence.h"
#include "airslam/common/error.h"
#include "airslam/geometry/so3.h"
#include "airslam/testing/synthetic_detector.h"

namespace airslam {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

constexpr double kDegree = std::numbers::pi / 180;

CalibrationReport Check(const Sequence& sequence) {
  SyntheticDetector detector;
  SyntheticMatcher matcher;
  RawMatchOptions options;
  options.frames = 10;
  return CheckCalibration(sequence, detector, matcher, options);
}

void ExpectFault(const Sequence& sequence, const std::string& fault, const std::string& begin) {
  const CalibrationReport report = Check(sequence);
  EXPECT_FALSE(report.right);
  EXPECT_EQ(report.fault, fault) << report.sentence;
  EXPECT_THAT(report.sentence, StartsWith(begin));
  EXPECT_EQ(report.sentence.find('\n'), std::string::npos);
}

TEST(CheckCalibration, NothingIsWrongWithAGoodOne) {
  const CalibrationReport report = Check(SpoiltFrames());
  EXPECT_TRUE(report.right);
  EXPECT_EQ(report.fault, "none");
  EXPECT_THAT(report.sentence, StartsWith("nothing is wrong: "));
  EXPECT_GT(report.rig.calibrated.size(), 300);
  EXPECT_LT(report.rig.noise, 0.5);
  EXPECT_LT(report.rig.turned.correction.turn.cwiseAbs().maxCoeff(), 0.1 * kDegree);
  EXPECT_LT(std::abs(report.rig.delayed.correction.delay), 2e-3);
  EXPECT_EQ(report.imu.unknown, "");
  EXPECT_LT(std::abs(report.imu.time_offset), 4e-3);
  EXPECT_NEAR(report.imu.turn_ratio, 1, 0.01);
  // Simulated with these densities.
  EXPECT_NEAR(report.measured_noise.gyroscope_noise_density,
              report.calibrated_noise.gyroscope_noise_density,
              0.2 * report.calibrated_noise.gyroscope_noise_density);
}

TEST(CheckCalibration, SwappedImages) {
  SpoiltFrames frames;
  frames.images = [&](int i) {
    StereoPair pair = frames.frames().pair(i);
    std::swap(pair.left, pair.right);
    return pair;
  };
  ExpectFault(frames, "swapped", "swapped cameras");
}

TEST(CheckCalibration, SwappedExtrinsics) {
  SpoiltFrames frames;
  std::swap(frames.spoil_rig().left.body_from_cam, frames.spoil_rig().right.body_from_cam);
  ExpectFault(frames, "swapped", "swapped cameras or an inverted extrinsic: ");
}

TEST(CheckCalibration, InvertedExtrinsics) {
  for (const auto& [left, right] : {std::pair{true, false}, {false, true}, {true, true}}) {
    SpoiltFrames frames;
    RigCamera &l = frames.spoil_rig().left, &r = frames.spoil_rig().right;
    if (left) l.body_from_cam = l.body_from_cam.Inverse();
    if (right) r.body_from_cam = r.body_from_cam.Inverse();
    ExpectFault(frames, "inverted", "inverted extrinsic: ");
  }
}

TEST(CheckCalibration, WrongDistortionModel) {
  SpoiltFrames frames;
  frames.spoil_rig().left.camera.model = Distortion::kEquidistant;
  frames.spoil_rig().right.camera.model = Distortion::kEquidistant;
  ExpectFault(frames, "distortion",
              "wrong distortion model: the images agree with the model \"radial-tangential\"");
}

TEST(CheckCalibration, WrongDistortionCoefficients) {
  for (const double factor : {0.0, 1.6}) {
    SpoiltFrames frames;
    for (RigCamera* camera : {&frames.spoil_rig().left, &frames.spoil_rig().right}) {
      for (double& k : camera->camera.coefficients) k *= factor;
    }
    ExpectFault(frames, "distortion", "wrong distortion model");
  }
}

TEST(CheckCalibration, IntrinsicsOfAnotherResolution) {
  for (const double scale : {0.5, 2.0}) {
    SpoiltFrames frames;
    for (RigCamera* camera : {&frames.spoil_rig().left, &frames.spoil_rig().right}) {
      Pinhole& p = camera->camera.pinhole;
      for (double* value : {&p.fx, &p.fy, &p.cx, &p.cy}) *value *= scale;
    }
    ExpectFault(frames, "resolution", "wrong resolution: ");
  }
}

TEST(CheckCalibration, TurnedCamera) {
  SpoiltFrames frames;
  Rigid3& extrinsic = frames.spoil_rig().right.body_from_cam;
  const Eigen::Vector3d turn(0.8 * kDegree, 0, -0.5 * kDegree);
  extrinsic.rotation = extrinsic.rotation * ExpSO3(-turn);
  const CalibrationReport report = Check(frames);
  EXPECT_EQ(report.fault, "turned") << report.sentence;
  EXPECT_LT((report.rig.turned.correction.turn - turn).cwiseAbs().maxCoeff(), 0.15 * kDegree);
}

TEST(CheckCalibration, RightImagesOfTheNextFrame) {
  SpoiltFrames frames;
  frames.images = [&](int i) {
    StereoPair pair = frames.frames().pair(i);
    pair.right = frames.frames().pair(i + 1).right;
    return pair;
  };
  ExpectFault(frames, "unsynchronised", "unsynchronised cameras: ");
}

TEST(CheckCalibration, RightImagesALittleLate) {
  SpoiltFrames frames;
  frames.images = [&](int i) {
    StereoPair pair = frames.frames().pair(i);
    pair.right = frames.frames().late_right(i);
    return pair;
  };
  const CalibrationReport report = Check(frames);
  EXPECT_EQ(report.fault, "unsynchronised") << report.sentence;
  EXPECT_NEAR(report.rig.delayed.correction.delay, 0.020, 0.004);
}

TEST(CheckCalibration, ClockOfTheImu) {
  SpoiltFrames frames;
  for (ImuSample& sample : frames.spoil_imu()) sample.timestamp_ns += 40'000'000;
  frames.spoil_rig().imu_time_offset = 0.010;
  const CalibrationReport report = Check(frames);
  EXPECT_EQ(report.fault, "time offset") << report.sentence;
  EXPECT_NEAR(report.imu.time_offset, 0.030, 0.006);
  EXPECT_THAT(report.sentence, StartsWith("unsynchronised IMU: "));
}

TEST(CheckCalibration, ExtrinsicOfTheImu) {
  SpoiltFrames frames;
  // Both cameras stand on the IMU as if it were turned: they still agree with each other.
  const Rigid3 turn(ExpSO3({0, 0, 30 * kDegree}), {0, 0, 0});
  for (RigCamera* camera : {&frames.spoil_rig().left, &frames.spoil_rig().right}) {
    camera->body_from_cam = turn * camera->body_from_cam;
  }
  const CalibrationReport report = Check(frames);
  EXPECT_EQ(report.fault, "IMU extrinsic") << report.sentence;
  EXPECT_NEAR(report.imu.rotation.norm(), 30 * kDegree, 4 * kDegree);
}

TEST(CheckCalibration, SaysWhenNothingCanBeSaid) {
  SpoiltFrames frames;
  frames.images = [&](int i) {
    StereoPair pair = frames.frames().pair(i);
    pair.right = cv::Mat(pair.right.size(), CV_8UC1, cv::Scalar(0));
    return pair;
  };
  ExpectFault(frames, "too few matches", "nothing can be said: ");
}

TEST(CheckCalibration, RestTellsNothingOfTheImu) {
  SpoiltFrames frames;
  frames.images = [&](int) { return frames.frames().pair(0); };
  const CalibrationReport report = Check(frames);
  EXPECT_TRUE(report.right) << report.sentence;
  EXPECT_THAT(report.imu.unknown, HasSubstr("turns too little"));
  EXPECT_THAT(report.sentence, HasSubstr("but the IMU was not compared: "));
}

TEST(CheckCalibration, ReportsAsTextAndJson) {
  const CalibrationReport report = Check(SpoiltFrames());
  const std::string text = FormatCalibrationReport(report);
  for (const char* part : {"vertical disparity", "rotation error", "IMU time offset",
                           "gyroscope noise", "images do not show its length"}) {
    EXPECT_THAT(text, HasSubstr(part));
  }
  EXPECT_THAT(text, ::testing::EndsWith(report.sentence + "\n"));
  const nlohmann::json json = CalibrationReportToJson(report);
  int matches = 0;
  for (const auto& bin : json["rig"]["vertical_disparity_px"]["histogram"]) {
    matches += bin["matches"].get<int>();
  }
  EXPECT_EQ(matches, json["matches"]);
  EXPECT_EQ(json["fault"], "none");
}

// A good calibration's curves go through the rings around the matches.
TEST(DrawEpipolarCurves, DrawsThroughTheMatches) {
  SpoiltFrames frames;
  SyntheticDetector detector;
  SyntheticMatcher matcher;
  RawMatchOptions options;
  options.frames = 1;
  const RawMatches matches = MatchRawImages(frames, detector, matcher, options);
  const cv::Mat picture = DrawEpipolarCurves(frames.rig(), frames.Read(0), matches, 0);
  EXPECT_EQ(picture.size(), cv::Size(960, 312));
  int coloured = 0;  // centres of rings in the right image
  for (const RawMatch& match : matches.matches) {
    const cv::Vec3b pixel =
        picture.at<cv::Vec3b>(cvRound(match.right.y()), 480 + cvRound(match.right.x()));
    coloured += pixel[0] != pixel[1] || pixel[1] != pixel[2];
  }
  EXPECT_GE(coloured, 15);
}

TEST(RawMatchOptions, NamesWhatIsWrong) {
  RawMatchOptions options;
  options.frames = 0;
  EXPECT_THROW(options.Validate(), Error);
  options = {};
  options.max_turn_span = 0.1;
  EXPECT_THROW(options.Validate(), Error);
}

}  // namespace
}  // namespace airslam
