// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/evaluate/trajectory_error.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <random>
#include <sstream>
#include <string>

#include "airslam/common/error.h"
#include "airslam/geometry/so3.h"
#include "airslam/sensor/temporary_folder.h"

namespace airslam {
namespace {

using testing::AllOf;
using testing::HasSubstr;

constexpr std::int64_t kStart = 1700000000000000000;

// A winding path; `count` poses at `rate` per second.
Trajectory Path(int count, double rate) {
  Trajectory trajectory;
  for (int i = 0; i < count; ++i) {
    const double t = i / rate;
    const Eigen::Vector3d position(3 * std::cos(0.4 * t), 2 * std::sin(0.4 * t), 0.3 * std::sin(t));
    trajectory.push_back({kStart + std::llround(t * 1e9),
                          {ExpSO3({0.2 * std::sin(t), 0.1 * t, 0.5 * t}), position}});
  }
  return trajectory;
}

// The path as an estimate: every `step`-th pose in another world frame, scaled, with drift and
// noise.
Trajectory NoisyEstimate(const Trajectory& path, int step, double scale) {
  std::mt19937 random(5);
  std::normal_distribution<double> noise(0, 1);
  const auto vector = [&] { return Eigen::Vector3d(noise(random), noise(random), noise(random)); };
  const Rigid3 other_from_world(ExpSO3({0.5, -1, 2}), {10, -20, 5});
  Trajectory estimate;
  for (std::size_t i = 0; i < path.size(); i += step) {
    Rigid3 pose = other_from_world * path[i].world_from_body;
    pose.translation = scale * (pose.translation + 0.05 * vector());
    pose.translation.x() += 0.002 * static_cast<double>(i);
    pose.rotation = pose.rotation * ExpSO3(0.02 * vector());
    estimate.push_back({path[i].timestamp_ns + 1'000'000, pose});  // a millisecond late
  }
  return estimate;
}

Trajectory Moved(const Trajectory& path, const Rigid3& other_from_world, double scale) {
  Trajectory moved = path;
  for (StampedPose& pose : moved) {
    pose.world_from_body = other_from_world * pose.world_from_body;
    pose.world_from_body.translation *= scale;
  }
  return moved;
}

TEST(EvaluateTrajectory, IsZeroForTheSamePathInAnotherFrame) {
  const Trajectory path = Path(100, 10);
  const Rigid3 other_from_world(ExpSO3({0.5, -1, 2}), {10, -20, 5});
  const TrajectoryErrors errors = EvaluateTrajectory(path, Moved(path, other_from_world, 1));
  EXPECT_EQ(errors.compared_poses, 100);
  EXPECT_LT(errors.position.max, 1e-9);
  EXPECT_LT(errors.relative_translation.max, 1e-9);
  EXPECT_LT(errors.relative_rotation.max, 1e-9);
  EXPECT_EQ(errors.relative_rotation.count, 99);
  EXPECT_EQ(errors.coverage, 1.0);
  EXPECT_NEAR(errors.duration, 9.9, 1e-9);
}

TEST(EvaluateTrajectory, AlignsOnlyAsAsked) {
  const Trajectory path = Path(100, 10);
  const Trajectory moved = Moved(path, {Eigen::Quaterniond::Identity(), {0, 0, 3}}, 1);
  EvaluationOptions options;
  options.alignment = TrajectoryAlignment::kNone;
  EXPECT_NEAR(EvaluateTrajectory(path, moved, options).position.rmse, 3, 1e-9);
  const Trajectory doubled = Moved(path, {}, 2);
  EXPECT_GT(EvaluateTrajectory(path, doubled).position.rmse, 1);
  options.alignment = TrajectoryAlignment::kSim3;
  const TrajectoryErrors scaled = EvaluateTrajectory(path, doubled, options);
  EXPECT_LT(scaled.position.rmse, 1e-9);
  EXPECT_LT(scaled.relative_translation.rmse, 1e-9);
  EXPECT_NEAR(scaled.groundtruth_from_estimate.scale, 0.5, 1e-12);
}

TEST(EvaluateTrajectory, StatisticsAreThoseOfTheDistances) {
  Trajectory path = Path(4, 10), estimate = path;
  const double offsets[] = {1, 2, 3, 6};
  for (int i = 0; i < 4; ++i) estimate[i].world_from_body.translation.y() += offsets[i];
  EvaluationOptions options;
  options.alignment = TrajectoryAlignment::kNone;
  const ErrorStatistics position = EvaluateTrajectory(path, estimate, options).position;
  EXPECT_NEAR(position.mean, 3, 1e-12);
  EXPECT_NEAR(position.median, 2.5, 1e-12);
  EXPECT_NEAR(position.max, 6, 1e-12);
  EXPECT_NEAR(position.rmse, std::sqrt(50 / 4.0), 1e-12);
  path.pop_back();
  EXPECT_NEAR(EvaluateTrajectory(path, estimate, options).position.median, 2, 1e-12);
}

TEST(EvaluateTrajectory, RelativeErrorsRunFromEveryDeltathPoseToTheNext) {
  const Trajectory path = Path(100, 10);
  Trajectory estimate = path;
  // A jump of 0.3 m before pose 7, of 0.1 rad before pose 50: each falls into one step of five.
  for (int i = 7; i < 100; ++i) estimate[i].world_from_body.translation.z() += 0.3;
  for (int i = 50; i < 100; ++i) {
    Eigen::Quaterniond& rotation = estimate[i].world_from_body.rotation;
    rotation = ExpSO3({0.1, 0, 0}) * rotation;  // of the world
  }
  EvaluationOptions options;
  options.alignment = TrajectoryAlignment::kNone;
  options.rpe_delta = 5;
  const TrajectoryErrors errors = EvaluateTrajectory(path, estimate, options);
  EXPECT_EQ(errors.relative_translation.count, 19);
  EXPECT_NEAR(errors.relative_translation.max, 0.3, 1e-9);
  EXPECT_NEAR(errors.relative_rotation.max, 0.1, 1e-9);
  EXPECT_NEAR(errors.relative_rotation.mean, 0.1 / 19, 1e-9);
}

TEST(AssociateByTime, TakesTheNearestWithinTheTolerance) {
  Trajectory dense(5), sparse(3);
  for (int i = 0; i < 5; ++i) dense[i].timestamp_ns = 100 + 10 * i;  // 100 ... 140
  sparse[0].timestamp_ns = 97;
  sparse[1].timestamp_ns = 116;
  sparse[2].timestamp_ns = 146;
  const auto pairs = AssociateByTime(dense, sparse, 5e-9);
  ASSERT_EQ(pairs.size(), 2u);
  EXPECT_EQ(pairs[0].groundtruth, 0);
  EXPECT_EQ(pairs[1].groundtruth, 2);
  EXPECT_EQ(pairs[1].estimate, 1);
  const auto swapped = AssociateByTime(sparse, dense, 6e-9);
  ASSERT_EQ(swapped.size(), 3u);
  EXPECT_EQ(swapped[2].groundtruth, 2);
  EXPECT_EQ(swapped[2].estimate, 4);
}

TEST(EvaluateTrajectory, CoverageSaysOfWhat) {
  const Trajectory path = Path(100, 10);
  Trajectory half(path.begin(), path.begin() + 50);
  TrajectoryErrors errors = EvaluateTrajectory(path, half);
  EXPECT_NEAR(errors.coverage, 0.5, 1e-12);
  EXPECT_THAT(errors.coverage_basis, HasSubstr("poses of the ground truth"));

  // Ground truth at 200 Hz: 50 of the 100 frames that fit into its time.
  errors = EvaluateTrajectory(Path(1981, 200), half);
  EXPECT_EQ(errors.coverage_frames, 100);
  EXPECT_NEAR(errors.coverage, 0.5, 1e-12);
  EXPECT_THAT(errors.coverage_basis, HasSubstr("median rate"));

  // The dataset has 80 frames, 10 of them after the end of the ground truth.
  std::vector<std::int64_t> frames;
  for (int i = 0; i < 80; ++i) frames.push_back(path[i].timestamp_ns);
  errors = EvaluateTrajectory(Trajectory(path.begin(), path.begin() + 70), half, {}, frames);
  EXPECT_EQ(errors.coverage_frames, 70);
  EXPECT_NEAR(errors.coverage, 50.0 / 70, 1e-12);
  EXPECT_THAT(errors.coverage_basis, HasSubstr("frames of the dataset"));
}

TEST(EvaluateTrajectory, SaysWhyItCannotCompare) {
  const Trajectory path = Path(100, 10);
  Trajectory late = path;
  for (StampedPose& pose : late) pose.timestamp_ns += 60'000'000'000;
  EXPECT_THAT(ErrorOf([&] { EvaluateTrajectory(path, late); }),
              AllOf(HasSubstr("share no times"), HasSubstr("1700000009.900 s"),
                    HasSubstr("1700000060.000 s")));
  const Trajectory two(path.begin(), path.begin() + 2);
  EXPECT_THAT(ErrorOf([&] { EvaluateTrajectory(path, two); }),
              AllOf(HasSubstr("SE(3) alignment is not determined"), HasSubstr("2 compared poses")));
  EXPECT_THAT(ErrorOf([&] { EvaluateTrajectory(path, {}); }), HasSubstr("without poses"));
  EvaluationOptions options;
  options.rpe_delta = 0;
  EXPECT_THAT(ErrorOf([&] { EvaluateTrajectory(path, path, options); }), HasSubstr("delta"));
}

// The evaluation tool evo, run on the files of this test.
class Evo : public testing::Test {
 protected:
  void SetUp() override {
    const char* elsewhere = std::getenv("AIRSLAM_EVO_BIN");
    bin_ = elsewhere ? elsewhere : AIRSLAM_SOURCE_DIR "/.venv/bin";
    if (!std::filesystem::exists(bin_ / "evo_ape")) {
      GTEST_SKIP() << "evo is not installed at " << bin_ / "evo_ape"
                   << ": the agreement with it was not tested (make test installs it)";
    }
    groundtruth_ = Path(2001, 100);
    estimate_ = NoisyEstimate(groundtruth_, 10, 1.1);
    estimate_.erase(estimate_.begin() + 40, estimate_.begin() + 55);  // a gap
    WriteTum(folder_.path() / "groundtruth.tum", groundtruth_);
    WriteTum(folder_.path() / "estimate.tum", estimate_);
  }

  // The statistics that evo prints.
  ErrorStatistics Run(const std::string& program, const std::string& options) const {
    const std::string at = folder_.path().string();
    const std::string command = "HOME=" + at + " " + (bin_ / program).string() + " tum " + at +
                                "/groundtruth.tum " + at + "/estimate.tum " + options + " > " + at +
                                "/out.txt 2>&1";
    const int code = std::system(command.c_str());
    std::ifstream stream(folder_.path() / "out.txt");
    std::ostringstream text;
    text << stream.rdbuf();
    EXPECT_EQ(code, 0) << text.str();
    ErrorStatistics statistics;
    std::istringstream lines(text.str());
    std::string name;
    while (lines >> name) {
      if (name == "rmse") lines >> statistics.rmse;
      if (name == "mean") lines >> statistics.mean;
      if (name == "median") lines >> statistics.median;
      if (name == "max") lines >> statistics.max;
    }
    EXPECT_GT(statistics.rmse, 0) << text.str();
    return statistics;
  }

  static void ExpectAgree(const ErrorStatistics& ours, const ErrorStatistics& evo) {
    const double tolerance = 1e-6;  // evo prints six decimals
    EXPECT_NEAR(ours.rmse, evo.rmse, tolerance + 1e-5 * evo.rmse);
    EXPECT_NEAR(ours.mean, evo.mean, tolerance + 1e-5 * evo.mean);
    EXPECT_NEAR(ours.median, evo.median, tolerance + 1e-5 * evo.median);
    EXPECT_NEAR(ours.max, evo.max, tolerance + 1e-5 * evo.max);
  }

  TrajectoryErrors Ours(TrajectoryAlignment alignment, int delta) const {
    EvaluationOptions options;
    options.alignment = alignment;
    options.rpe_delta = delta;
    return EvaluateTrajectory(groundtruth_, estimate_, options);
  }

  static ErrorStatistics InDegrees(ErrorStatistics s) {
    for (double* value : {&s.rmse, &s.mean, &s.median, &s.max}) *value *= 180 / std::acos(-1.0);
    return s;
  }

  TemporaryFolder folder_;
  std::filesystem::path bin_;
  Trajectory groundtruth_, estimate_;
};

TEST_F(Evo, AbsoluteErrorsAgree) {
  ExpectAgree(Ours(TrajectoryAlignment::kSe3, 1).position, Run("evo_ape", "-a"));
  ExpectAgree(Ours(TrajectoryAlignment::kSim3, 1).position, Run("evo_ape", "-as"));
  ExpectAgree(Ours(TrajectoryAlignment::kNone, 1).position, Run("evo_ape", ""));
}

TEST_F(Evo, RelativeErrorsAgree) {
  const TrajectoryErrors one = Ours(TrajectoryAlignment::kSe3, 1);
  ExpectAgree(one.relative_translation, Run("evo_rpe", "-a"));
  ExpectAgree(InDegrees(one.relative_rotation), Run("evo_rpe", "-r angle_deg"));
  const TrajectoryErrors seven = Ours(TrajectoryAlignment::kSim3, 7);
  ExpectAgree(seven.relative_translation, Run("evo_rpe", "-as --delta 7 --delta_unit f"));
}

}  // namespace
}  // namespace airslam
