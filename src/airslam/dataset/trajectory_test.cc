// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/dataset/trajectory.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <sstream>
#include <string>

#include "airslam/geometry/so3.h"
#include "airslam/sensor/temporary_folder.h"

namespace airslam {
namespace {

using testing::AllOf;
using testing::HasSubstr;

std::string TextOf(const std::filesystem::path& file) {
  std::ifstream stream(file);
  std::ostringstream text;
  text << stream.rdbuf();
  return text.str();
}

TEST(WriteTum, WritesTimesExactly) {
  const TemporaryFolder folder;
  const auto file = folder.path() / "t.tum";
  Trajectory trajectory(3);
  trajectory[0].timestamp_ns = -1;
  trajectory[1].timestamp_ns = 5;
  trajectory[2].timestamp_ns = 1403715273262142976;
  trajectory[2].world_from_body.translation = {1, -2.5, 1e-9};
  WriteTum(file, trajectory);
  EXPECT_EQ(TextOf(file),
            "-0.000000001 0.000000000 0.000000000 0.000000000 0.000000000 0.000000000 0.000000000 "
            "1.000000000\n"
            "0.000000005 0.000000000 0.000000000 0.000000000 0.000000000 0.000000000 0.000000000 "
            "1.000000000\n"
            "1403715273.262142976 1.000000000 -2.500000000 0.000000001 0.000000000 0.000000000 "
            "0.000000000 1.000000000\n");
}

TEST(WriteTum, IsReadBackAsWritten) {
  const TemporaryFolder folder;
  const auto file = folder.path() / "t.tum";
  Trajectory trajectory;
  for (int i = 0; i < 20; ++i) {
    trajectory.push_back({1700000000000000000 + i * 33333333,
                          {ExpSO3({0.1 * i, -0.2, 0.3}), {1.0 * i, -i / 3.0, 7}}});
  }
  WriteTum(file, trajectory);
  const Trajectory back = ReadTrajectory(file);
  ASSERT_EQ(back.size(), trajectory.size());
  for (std::size_t i = 0; i < back.size(); ++i) {
    EXPECT_EQ(back[i].timestamp_ns, trajectory[i].timestamp_ns);
    const Rigid3 difference = back[i].world_from_body.Inverse() * trajectory[i].world_from_body;
    EXPECT_LT(difference.translation.norm(), 2e-9);
    EXPECT_LT(LogSO3(difference.rotation).norm(), 5e-9);
  }
}

TEST(WriteTum, ReplacesAnEarlierFileAndLeavesNoOther) {
  const TemporaryFolder folder;
  const auto file = folder.Write("t.tum", "old\n");
  WriteTum(file, Trajectory(1));
  EXPECT_THAT(TextOf(file), testing::StartsWith("0.000000000 "));
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}), 1);
}

TEST(WriteTum, SaysWhereItCannotWrite) {
  EXPECT_THAT(ErrorOf([] { WriteTum("/nonexistent/t.tum", {}); }),
              AllOf(HasSubstr("/nonexistent/t.tum"), HasSubstr("cannot be written")));
}

TEST(ReadTrajectory, ReadsTumAndSorts) {
  const TemporaryFolder folder;
  const Trajectory t = ReadTrajectory(
      folder.Write("t.tum",
                   "# t x y z qx qy qz qw\n12.5 1 2 3 0 0 0.7071067811865476 0.7071067811865476\n"
                   "1.037359e-01 4 5 6 0 0 0 1\r\n"));
  ASSERT_EQ(t.size(), 2u);
  EXPECT_EQ(t[0].timestamp_ns, 103735900);
  EXPECT_EQ(t[1].timestamp_ns, 12500000000);
  EXPECT_EQ(t[1].world_from_body.translation, Eigen::Vector3d(1, 2, 3));
  // A quarter turn about z: x becomes y.
  EXPECT_LT(
      (t[1].world_from_body.rotation * Eigen::Vector3d::UnitX() - Eigen::Vector3d::UnitY()).norm(),
      1e-12);
}

TEST(ReadTrajectory, UnderstandsNanosecondsInATumFile) {
  const TemporaryFolder folder;
  const Trajectory t =
      ReadTrajectory(folder.Write("t.txt", "1403715273262142976.000000 1 2 3 0 0 0 1\n"));
  EXPECT_EQ(t.at(0).timestamp_ns, 1403715273262142976);
}

TEST(ReadTrajectory, ReadsEurocGroundTruth) {
  const TemporaryFolder folder;
  const Trajectory t = ReadTrajectory(
      folder.Write("data.csv",
                   "#timestamp [ns], p_RS_R_x [m], ...\n"
                   "1403715273262142976,0.878895,2.1834,0.948427,0.5,0.5,-0.5,0.5,0.1,0.2,0.3\n"));
  ASSERT_EQ(t.size(), 1u);
  EXPECT_EQ(t[0].timestamp_ns, 1403715273262142976);
  EXPECT_EQ(t[0].world_from_body.translation.y(), 2.1834);
  EXPECT_EQ(t[0].world_from_body.rotation.w(), 0.5);  // q_wxyz
  EXPECT_EQ(t[0].world_from_body.rotation.y(), -0.5);
}

TEST(ReadTrajectory, ReadsKittiPosesWithTheTimesBesideThem) {
  const TemporaryFolder folder;
  const auto file =
      folder.Write("poses.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n0 -1 0 1 1 0 0 2 0 0 1 3\n");
  EXPECT_EQ(ReadTrajectory(file).at(1).timestamp_ns, 1000000000);  // the running number
  folder.Write("times.txt", "0.000000e+00\n1.037359e-01\n");
  const Trajectory t = ReadTrajectory(file);
  ASSERT_EQ(t.size(), 2u);
  EXPECT_EQ(t[1].timestamp_ns, 103735900);
  EXPECT_EQ(t[1].world_from_body.translation, Eigen::Vector3d(1, 2, 3));
  EXPECT_LT((t[1].world_from_body * Eigen::Vector3d(1, 0, 0) - Eigen::Vector3d(1, 3, 3)).norm(),
            1e-12);
  folder.Write("times.txt", "0.0\n");
  EXPECT_THAT(ErrorOf([&] { ReadTrajectory(file); }),
              HasSubstr("poses.txt:2: times.txt beside the file has only 1 lines"));
}

TEST(ReadTrajectory, NamesFileAndLine) {
  const TemporaryFolder folder;
  const auto error_of = [&](const std::string& text) {
    const auto file = folder.Write("t.txt", text);
    return ErrorOf([&] { ReadTrajectory(file); });
  };
  EXPECT_THAT(error_of("1 0 0 0 0 0 0 1\n2 0 0 0 0 0 1\n"),
              AllOf(HasSubstr("t.txt:2"), HasSubstr("expected 8 numbers"), HasSubstr("got 7")));
  EXPECT_THAT(error_of("1 0 0 x 0 0 0 1\n"), HasSubstr("t.txt:1: \"x\" is not a number"));
  EXPECT_THAT(error_of("1 0 0 nan 0 0 0 1\n"), HasSubstr("t.txt:1: \"nan\" is not a number"));
  EXPECT_THAT(error_of("t1 0 0 0 0 0 0 1\n\n-a 0 0 0 0 0 0 1\n"),
              HasSubstr("t.txt:3: \"-a\" is not a time in seconds"));
  EXPECT_THAT(error_of("1 0 0 0 0 0 0 2\n"), HasSubstr("t.txt:1: the quaternion has the length 2"));
  EXPECT_THAT(error_of("1 2 3\n"), HasSubstr("t.txt:1: expected a TUM line"));
  EXPECT_THAT(error_of("2 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 1\n"),
              HasSubstr("t.txt:3: the time 2.000000000 occurs already in line 1"));
  EXPECT_THAT(error_of("1 0 0 0 0 1 0 0 0 0 2 0\n"), HasSubstr("t.txt:1: the 3x4 matrix"));
  EXPECT_THAT(error_of("1,0,0,0,1,0,0\n"), HasSubstr("t.txt:1: expected a time, a position"));
  EXPECT_THAT(error_of("1.5,0,0,0,1,0,0,0\n"),
              HasSubstr("t.txt:1: \"1.5\" is not a time in whole"));
  EXPECT_THAT(error_of("# only a comment\n"), HasSubstr("t.txt holds no pose"));
  EXPECT_THAT(ErrorOf([&] { ReadTrajectory(folder.path() / "none.tum"); }),
              HasSubstr("none.tum cannot be read"));
}

}  // namespace
}  // namespace airslam
