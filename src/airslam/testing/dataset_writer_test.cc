// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/testing/dataset_writer.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <opencv2/core.hpp>

#include "airslam/common/error.h"

namespace airslam {
namespace {

namespace fs = std::filesystem;

class DatasetWriterTest : public ::testing::Test {
 protected:
  DatasetWriterTest() {
    const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
    folder_ = fs::temp_directory_path() /
              (std::string("airslam_writer_") + info->name() + "_" + std::to_string(getpid()));
    fs::remove_all(folder_);
  }
  ~DatasetWriterTest() override { fs::remove_all(folder_); }

  fs::path folder_;
};

SyntheticSequenceOptions Small(const StereoRig& rig) {
  SyntheticSequenceOptions options;
  options.rig = rig;
  options.frames = 5;
  options.imu.gyroscope_bias = {0.01, 0.02, -0.03};
  return options;
}

void ExpectSameImages(const Sequence& a, const Sequence& b) {
  for (int i = 0; i < a.size(); ++i) {
    const StereoPair x = a.Read(i), y = b.Read(i);
    ASSERT_EQ(x.left.size(), y.left.size());
    EXPECT_EQ(cv::norm(x.left, y.left, cv::NORM_INF), 0) << "frame " << i;
    EXPECT_EQ(cv::norm(x.right, y.right, cv::NORM_INF), 0) << "frame " << i;
  }
}

void ExpectSameCamera(const RigCamera& a, const RigCamera& b) {
  EXPECT_NEAR(a.camera.pinhole.fx, b.camera.pinhole.fx, 1e-9);
  EXPECT_NEAR(a.camera.pinhole.fy, b.camera.pinhole.fy, 1e-9);
  EXPECT_NEAR(a.camera.pinhole.cx, b.camera.pinhole.cx, 1e-9);
  EXPECT_NEAR(a.camera.pinhole.cy, b.camera.pinhole.cy, 1e-9);
  for (int i = 0; i < 4; ++i) EXPECT_EQ(a.camera.coefficients[i], b.camera.coefficients[i]);
  const Rigid3 between = a.body_from_cam.Inverse() * b.body_from_cam;
  EXPECT_LT(between.translation.norm(), 1e-9);
  EXPECT_LT(between.Angle(), 1e-6);
}

TEST_F(DatasetWriterTest, EurocFolderReadsBackAsTheSequence) {
  const SyntheticSequence sequence(Small(EurocLikeRig(160, 104)));
  WriteEurocFolder(sequence, folder_);
  const auto read = OpenSequence(folder_);
  ASSERT_EQ(read->size(), sequence.size());
  EXPECT_TRUE(read->warnings().empty());
  for (int i = 0; i < read->size(); ++i) {
    EXPECT_EQ(read->timestamp_ns(i), sequence.timestamp_ns(i));
  }
  ExpectSameImages(sequence, *read);
  ExpectSameCamera(sequence.rig().left, read->rig().left);
  ExpectSameCamera(sequence.rig().right, read->rig().right);
  ASSERT_TRUE(read->rig().imu);
  EXPECT_EQ(read->rig().imu->accelerometer_noise_density, 2.0e-3);
  ASSERT_EQ(read->imu().size(), sequence.imu().size());
  ASSERT_EQ(read->imu().size(), 81u);  // 0.4 s at 200 Hz
  for (std::size_t i = 0; i < read->imu().size(); ++i) {
    EXPECT_EQ(read->imu()[i].timestamp_ns, sequence.imu()[i].timestamp_ns);
    EXPECT_LT((read->imu()[i].acceleration - sequence.imu()[i].acceleration).norm(), 1e-11);
    EXPECT_LT((read->imu()[i].angular_velocity - sequence.imu()[i].angular_velocity).norm(), 1e-11);
  }
}

TEST_F(DatasetWriterTest, EurocGroundTruthReadsBack) {
  const SyntheticSequence sequence(Small(EurocLikeRig(64, 48)));
  WriteEurocFolder(sequence, folder_);
  const Trajectory truth =
      ReadTrajectory(folder_ / "mav0" / "state_groundtruth_estimate0" / "data.csv");
  ASSERT_EQ(truth.size(), 81u);
  for (const StampedPose& pose : truth) {
    const Rigid3 between = pose.world_from_body.Inverse() *
                           sequence.trajectory().At(pose.timestamp_ns).world_from_body;
    EXPECT_LT(between.translation.norm(), 1e-7);
    EXPECT_LT(between.Angle(), 1e-7);
  }
}

TEST_F(DatasetWriterTest, KittiFolderReadsBackAsTheSequence) {
  const SyntheticSequence sequence(Small(KittiLikeRig(160, 104)));
  WriteKittiFolder(sequence, folder_);
  const auto read = OpenSequence(folder_);
  ASSERT_EQ(read->size(), sequence.size());
  ExpectSameImages(sequence, *read);
  ExpectSameCamera(sequence.rig().left, read->rig().left);
  ExpectSameCamera(sequence.rig().right, read->rig().right);
  EXPECT_TRUE(read->rig().already_rectified);
  EXPECT_TRUE(read->imu().empty());
  EXPECT_EQ(read->timestamp_ns(3), 300'000'000);
  const Trajectory truth = ReadTrajectory(folder_ / "poses.txt");
  ASSERT_EQ(truth.size(), 5u);
  const Rigid3 first_from_world = sequence.states()[0].world_from_body.Inverse();
  const Rigid3 expected = first_from_world * sequence.states()[4].world_from_body;
  EXPECT_LT((truth[4].world_from_body.translation - expected.translation).norm(), 1e-6);
}

TEST_F(DatasetWriterTest, RefusesWhatTheLayoutCannotHold) {
  const SyntheticSequence sequence(Small(EurocLikeRig(64, 48)));
  EXPECT_THROW(WriteKittiFolder(sequence, folder_), Error);
  StereoRig fisheye = EurocLikeRig(64, 48);
  fisheye.left.camera.model = Distortion::kEquidistant;
  fisheye.left.camera.coefficients = {0, 0, 0, 0};
  const SyntheticSequence equidistant(Small(fisheye));
  EXPECT_THROW(WriteEurocFolder(equidistant, folder_), Error);
  EXPECT_THROW(WriteEurocFolder(sequence, "/proc/no_such_place"), Error);
}

TEST(SyntheticSequenceTest, LightFollowsTheFrameAndReadingRepeats) {
  SyntheticSequenceOptions options = Small(EurocLikeRig(160, 104));
  options.light = [](int index) {
    return index == 2 ? Illumination::Dark(static_cast<std::uint32_t>(index)) : Illumination::Day();
  };
  const SyntheticSequence sequence(options);
  EXPECT_GT(cv::mean(sequence.Read(1).left)[0], 60);
  EXPECT_LT(cv::mean(sequence.Read(2).left)[0], 30);
  EXPECT_EQ(cv::norm(sequence.Read(2).right, sequence.Read(2).right, cv::NORM_INF), 0);
  const Trajectory truth = sequence.ground_truth();
  ASSERT_EQ(truth.size(), 5u);
  EXPECT_EQ(truth[4].timestamp_ns, sequence.timestamp_ns(4));
}

TEST(SyntheticSequenceTest, ImuHoldsItsBiasesAndNothingElseWithoutNoise) {
  SyntheticSequenceOptions options = Small(EurocLikeRig(64, 48));
  options.imu_noise = false;
  const SyntheticSequence sequence(options);
  const BodyState state = sequence.trajectory().At(sequence.imu()[40].timestamp_ns);
  EXPECT_LT((sequence.imu()[40].angular_velocity - state.angular_velocity_in_body -
             options.imu.gyroscope_bias)
                .norm(),
            1e-12);
  EXPECT_TRUE(SyntheticSequence(Small(KittiLikeRig(64, 48))).imu().empty());
}

}  // namespace
}  // namespace airslam
