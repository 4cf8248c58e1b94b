// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/bundle.h"

#include <ceres/problem.h>
#include <ceres/solver.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <random>

#include "airslam/geometry/so3.h"
#include "airslam/optimize/point_factor.h"
#include "airslam/optimize/pose_optimization.h"
#include "airslam/optimize/pose_parameter.h"

namespace airslam {
namespace {

constexpr double kSigma = 0.3;  // pixels: what observations say they err by

// Keyframes along a gentle curve that look at a cloud of points.
struct Scene {
  StereoCamera stereo{{450, 455, 320, 240, 640, 480}, 0.12};
  std::vector<Rigid3> poses;
  std::vector<Eigen::Vector3d> points;
  std::vector<BundleProblem::Observation> observations;
  std::vector<bool> corrupted;
};

// `noise_sigma`, pixels: what observations do err by; `off`: what outliers are off.
Scene MakeScene(int poses, int points, double outlier_share, double noise_sigma = kSigma,
                double off = 15) {
  Scene scene;
  std::mt19937 random(11);
  std::normal_distribution<double> noise(0, noise_sigma);
  std::uniform_real_distribution<double> unit(0, 1);
  for (int i = 0; i < poses; ++i) {
    scene.poses.emplace_back(ExpSO3({0.01 * i, 0.03 * i, -0.005 * i}),
                             Eigen::Vector3d(0.2 * i, 0.02 * i * i, 0.05 * i));
  }
  for (int j = 0; j < points; ++j) {
    scene.points.emplace_back(6 * unit(random) - 3, 4 * unit(random) - 2, 3 + 5 * unit(random));
    for (int i = 0; i < poses; ++i) {
      const Eigen::Vector3d p = scene.poses[i].Inverse() * scene.points[j];
      const Eigen::Vector2d pixel = scene.stereo.camera.Project(p);
      if (!scene.stereo.camera.Contains(pixel)) continue;
      const bool corrupt = unit(random) < outlier_share;
      PointObservation seen{pixel, pixel.x() - scene.stereo.Disparity(p.z()), kSigma};
      seen.pixel += Eigen::Vector2d(noise(random), noise(random));
      seen.right_x += noise(random);
      if (corrupt) seen.pixel.y() += off;
      scene.observations.push_back({i, j, seen});
      scene.corrupted.push_back(corrupt);
    }
  }
  return scene;
}

Rigid3 Disturb(const Rigid3& pose, double angle, double distance) {
  return pose * Rigid3(ExpSO3({angle, -angle, 0.5 * angle}),
                       Eigen::Vector3d(distance, -distance, 0.5 * distance));
}

// Poses 0 and 1 see points, and so do 2 and 3, but nothing ties the two pairs but a loop.
BundleProblem TwoPairs(const Scene& scene) {
  BundleProblem problem{scene.stereo, scene.poses, {true, false, false, false}, scene.points, {}};
  const int points = static_cast<int>(scene.points.size());
  problem.points_in_world.insert(problem.points_in_world.end(), scene.points.begin(),
                                 scene.points.end());
  for (BundleProblem::Observation o : scene.observations) {
    if (o.pose >= 2) o.point += points;
    problem.observations.push_back(o);
  }
  return problem;
}

TEST(Bundle, ALoopTiesWhatSharesNoPoint) {
  const Scene scene = MakeScene(4, 100, 0);
  BundleProblem problem = TwoPairs(scene);
  const Rigid3 drift(ExpSO3({0.02, -0.01, 0.03}), {0.1, 0.05, -0.2});
  for (int i : {2, 3}) problem.world_from_cam[i] = drift * problem.world_from_cam[i];
  for (std::size_t j = scene.points.size(); j < problem.points_in_world.size(); ++j) {
    problem.points_in_world[j] = drift * problem.points_in_world[j];
  }
  problem.relative_poses = {
      {1, 2, scene.poses[1].Inverse() * scene.poses[2], 1e-6 * Matrix6d::Identity()}};
  BundleOptions options;
  options.robust_iterations = 30;
  options.function_tolerance = 1e-10;
  SolveBundle(options, &problem);
  for (int i : {1, 2, 3}) {
    const Rigid3 error = scene.poses[i].Inverse() * problem.world_from_cam[i];
    EXPECT_LT(error.translation.norm(), 0.02) << i;
    EXPECT_LT(error.Angle(), 0.005) << i;
  }
}

TEST(Bundle, SparseEqualsDense) {
  const Scene scene = MakeScene(6, 150, 0.1);
  BundleProblem dense{scene.stereo,
                      scene.poses,
                      {true, false, false, false, false, false},
                      scene.points,
                      scene.observations};
  for (int i = 1; i < 6; ++i) dense.world_from_cam[i] = Disturb(scene.poses[i], 0.01, 0.03);
  BundleProblem sparse = dense;
  BundleOptions options;
  SolveBundle(options, &dense);
  options.sparse = true;
  int last = -1;
  options.on_iteration = [&](int iteration) { last = iteration; };
  const BundleSummary summary = SolveBundle(options, &sparse);
  EXPECT_GE(last, options.robust_iterations) << "both rounds are reported";
  EXPECT_LT(summary.final_rms, 1.3);
  for (int i = 0; i < 6; ++i) {
    EXPECT_LT((dense.world_from_cam[i].translation - sparse.world_from_cam[i].translation).norm(),
              1e-6);
  }
}

// Five poses among points, those after the first disturbed, solved; the largest error of a
// position.
double SolveAndMeasure(const Scene& scene, const BundleOptions& options, BundleSummary* summary) {
  BundleProblem problem{scene.stereo,
                        scene.poses,
                        {true, false, false, false, false},
                        scene.points,
                        scene.observations};
  for (int i = 1; i < 5; ++i) problem.world_from_cam[i] = Disturb(scene.poses[i], 0.01, 0.03);
  *summary = SolveBundle(options, &problem);
  double largest = 0;
  for (int i = 1; i < 5; ++i) {
    const Rigid3 error = scene.poses[i].Inverse() * problem.world_from_cam[i];
    largest = std::max(largest, error.translation.norm());
  }
  return largest;
}

TEST(Bundle, BoundsShrinkWithTheResiduals) {
  // An outlier of 0.8 pixels lies within 3.5 sigmas, and far from what all others err by.
  const Scene scene = MakeScene(5, 150, 0.05, 0.05, 0.8);
  BundleOptions options;
  BundleSummary fixed, shrunk;
  const double with_fixed = SolveAndMeasure(scene, options, &fixed);
  options.least_scale = 0.1;
  const double with_shrunk = SolveAndMeasure(scene, options, &shrunk);
  EXPECT_LT(with_shrunk, 0.5 * with_fixed);
  int wrong = 0;
  for (std::size_t i = 0; i < scene.observations.size(); ++i) {
    wrong += shrunk.outlier[i] != scene.corrupted[i];
  }
  EXPECT_LE(wrong, static_cast<int>(scene.observations.size()) / 100);
  EXPECT_EQ(std::ranges::count(fixed.outlier, true), 0);
}

TEST(Bundle, BoundsStayWhereResidualsAreAsLargeAsTheirSigmas) {
  const Scene scene = MakeScene(5, 150, 0.15, 1.2 * kSigma);
  BundleOptions options;
  BundleSummary fixed, free;
  const double with_fixed = SolveAndMeasure(scene, options, &fixed);
  options.least_scale = 0.1;
  EXPECT_EQ(SolveAndMeasure(scene, options, &free), with_fixed);
  EXPECT_EQ(free.outlier, fixed.outlier);
}

TEST(OptimizePose, FindsThePoseAmongOutliers) {
  const Scene scene = MakeScene(1, 200, 0.25);
  std::vector<PointConstraint> constraints;
  for (const auto& o : scene.observations) {
    constraints.push_back({scene.points[o.point], o.seen});
  }
  const PoseOptimizationResult result =
      OptimizePose(scene.stereo, constraints, Disturb(scene.poses[0], 0.02, 0.1), {}, {});
  const Rigid3 error = scene.poses[0].Inverse() * result.world_from_cam;
  EXPECT_LT(error.translation.norm(), 0.003);
  EXPECT_LT(error.Angle(), 0.0007);
  EXPECT_NEAR(result.rms, std::sqrt(2.0), 0.2);  // of a two-dimensional error, in sigmas
  for (std::size_t i = 0; i < constraints.size(); ++i) {
    EXPECT_FALSE(scene.corrupted[i] && result.inlier[i]) << i;
  }
}

TEST(OptimizePose, APriorHoldsWhatFewPointsLeaveOpen) {
  const Scene scene = MakeScene(1, 200, 0);
  // Five points close together in the image.
  std::vector<PointConstraint> constraints;
  for (const auto& o : scene.observations) {
    if ((o.seen.pixel - Eigen::Vector2d(400, 300)).norm() > 45) continue;
    constraints.push_back({scene.points[o.point], {o.seen.pixel, -1, kSigma}});
  }
  ASSERT_GE(constraints.size(), 4u);
  const Rigid3 start = Disturb(scene.poses[0], 0.001, 0.005);
  const auto error = [&](const std::optional<PosePrior>& prior) {
    const Rigid3 pose = OptimizePose(scene.stereo, constraints, start, prior, {}).world_from_cam;
    return (pose.translation - scene.poses[0].translation).norm();
  };
  EXPECT_LT(error(PosePrior{start, 0.005, 0.01}), 0.015);
  EXPECT_GT(error({}), 0.03);
}

// The scatter of poses found from noisy points is what PoseInformation says.
TEST(OptimizePose, TheInformationIsThatOfTheScatter) {
  const Scene scene = MakeScene(1, 60, 0);
  std::vector<PointConstraint> constraints;
  for (const auto& o : scene.observations) constraints.push_back({scene.points[o.point], o.seen});
  const Matrix6d information = PoseInformation(scene.stereo, constraints, scene.poses[0]);
  std::mt19937 random(3);
  double nees = 0;
  constexpr int kRuns = 300;
  const Rigid3 cam_from_world = scene.poses[0].Inverse();
  for (int run = 0; run < kRuns; ++run) {
    for (PointConstraint& c : constraints) {
      const Eigen::Vector3d p = cam_from_world * c.point_in_world;
      PointObservation& seen = c.observation;
      const Eigen::Vector2d exact = scene.stereo.camera.Project(p);
      std::normal_distribution<double> noise(0, seen.sigma);
      seen.pixel = exact + Eigen::Vector2d(noise(random), noise(random));
      if (!seen.has_right()) continue;
      seen.right_x = exact.x() - scene.stereo.Disparity(p.z()) + noise(random);
    }
    const Rigid3 pose =
        OptimizePose(scene.stereo, constraints, scene.poses[0], {}, {.max_error = 100})
            .world_from_cam;
    Eigen::Matrix<double, 6, 1> error;
    error << LogSO3(scene.poses[0].rotation.conjugate() * pose.rotation),
        pose.translation - scene.poses[0].translation;
    nees += error.dot(information * error) / kRuns;
  }
  EXPECT_NEAR(nees, 6, 4 * std::sqrt(2 * 6.0 / kRuns));  // 4 standard deviations of the mean
}

// The least squares of points, some without a right image, and a prior, as Ceres finds them.
Rigid3 PoseByCeres(const StereoCamera& stereo, std::vector<PointConstraint> constraints,
                   const Rigid3& start, const PosePrior& prior) {
  PoseParameter pose = ToParameter(start);
  ceres::Problem problem;
  for (PointConstraint& c : constraints) {
    problem.AddResidualBlock(new PointFactor(stereo, c.observation), nullptr, pose.data(),
                             c.point_in_world.data());
    problem.SetParameterBlockConstant(c.point_in_world.data());
  }
  problem.AddResidualBlock(new PosePriorFactor(prior), nullptr, pose.data());
  problem.SetManifold(pose.data(), new PoseManifold);
  ceres::Solver::Options options;
  options.function_tolerance = options.parameter_tolerance = 1e-14;
  options.max_num_iterations = 100;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  return FromParameter(pose);
}

TEST(OptimizePose, EndsWhereCeresDoes) {
  const Scene scene = MakeScene(1, 60, 0);
  std::vector<PointConstraint> constraints;
  for (const auto& o : scene.observations) {
    constraints.push_back({scene.points[o.point], o.seen});
    if (constraints.size() % 3 == 0) constraints.back().observation.right_x = -1;
  }
  const Rigid3 start = Disturb(scene.poses[0], 0.03, 0.1);
  const PosePrior prior(Disturb(scene.poses[0], 0.002, 0.005), 0.001, 0.003);
  const Rigid3 expected = PoseByCeres(scene.stereo, constraints, start, prior);
  // One round is without a robust loss; no observation is an outlier.
  const Rigid3 found = OptimizePose(scene.stereo, constraints, start, prior,
                                    {.rounds = 1, .iterations_per_round = 30, .max_error = 1e3})
                           .world_from_cam;
  EXPECT_GT((expected.translation - prior.world_from_cam.translation).norm(), 1e-4);
  EXPECT_LT((expected.translation - found.translation).norm(), 1e-6);
  EXPECT_LT(expected.rotation.angularDistance(found.rotation), 1e-6);
}

TEST(OptimizePose, StaysWhereNumbersAreNone) {
  const Scene scene = MakeScene(1, 60, 0);
  std::vector<PointConstraint> constraints;
  for (const auto& o : scene.observations) constraints.push_back({scene.points[o.point], o.seen});
  constraints[3].point_in_world.x() = std::numeric_limits<double>::quiet_NaN();
  const Rigid3 start = Disturb(scene.poses[0], 0.01, 0.02);
  const PoseOptimizationResult result = OptimizePose(scene.stereo, constraints, start, {}, {});
  EXPECT_TRUE(result.world_from_cam.translation.allFinite());
  EXPECT_FALSE(result.inlier[3]);
}

TEST(OptimizePose, TooFewConstraintsGiveNoInliers) {
  const PoseOptimizationResult result =
      OptimizePose({}, std::vector<PointConstraint>(3), {}, {}, {});
  EXPECT_EQ(result.inliers, 0);
}

TEST(SolveBundle, RecoversPosesAndPointsAndRejectsOutliers) {
  const Scene scene = MakeScene(8, 300, 0.05);
  BundleProblem problem;
  problem.stereo = scene.stereo;
  problem.observations = scene.observations;
  for (int i = 0; i < 8; ++i) {
    problem.world_from_cam.push_back(i == 0 ? scene.poses[0]
                                            : Disturb(scene.poses[i], 0.004, 0.03));
    problem.pose_fixed.push_back(i == 0);
  }
  for (const Eigen::Vector3d& p : scene.points) {
    problem.points_in_world.push_back(1.03 * p + Eigen::Vector3d(0.01, -0.02, 0));
  }
  const BundleSummary summary = SolveBundle({}, &problem);
  EXPECT_LT(summary.final_rms, 1.1);
  EXPECT_GT(summary.initial_rms, 3 * summary.final_rms);
  for (int i = 0; i < 8; ++i) {
    const Rigid3 error = scene.poses[i].Inverse() * problem.world_from_cam[i];
    EXPECT_LT(error.translation.norm(), 0.01) << i;
    EXPECT_LT(error.Angle(), 0.002) << i;
  }
  // Where only two keyframes see a point nobody can tell which of them is wrong.
  int missed = 0, corrupted = 0;
  for (std::size_t k = 0; k < scene.corrupted.size(); ++k) {
    corrupted += scene.corrupted[k];
    missed += scene.corrupted[k] && !summary.outlier[k];
  }
  EXPECT_LE(missed, corrupted / 20);
}

TEST(SolveBundle, RepeatsBitByBitAndKeepsFixedPoses) {
  const Scene scene = MakeScene(5, 100, 0.05);
  BundleProblem first{scene.stereo,
                      scene.poses,
                      {true, false, false, false, false},
                      scene.points,
                      scene.observations};
  BundleProblem second = first;
  SolveBundle({}, &first);
  SolveBundle({}, &second);
  EXPECT_EQ(first.world_from_cam[0].translation, scene.poses[0].translation);
  for (int i = 0; i < 5; ++i) {
    EXPECT_EQ(first.world_from_cam[i].ToMatrix(), second.world_from_cam[i].ToMatrix());
  }
  EXPECT_EQ(first.points_in_world, second.points_in_world);
}

// A scene with few points, all in one corner of the images, and twelve edges of a room; every
// eighth line observation is shifted.
struct LineScene {
  Scene points;
  std::vector<PluckerLine> lines;
  std::vector<BundleProblem::LineSeen> seen;
  std::vector<bool> shifted;
};

LineScene MakeLineScene() {
  LineScene scene{MakeScene(5, 400, 0), {}, {}, {}};
  std::vector<bool> kept(scene.points.points.size(), true);
  for (std::size_t j = 0; j < kept.size(); ++j) {
    const Eigen::Vector3d& p = scene.points.points[j];
    kept[j] = p.x() > 0.5 && p.x() < 1.3 && p.y() > 0.5 && p.y() < 1.3 && p.z() > 5;
  }
  std::erase_if(scene.points.observations,
                [&](const BundleProblem::Observation& o) { return !kept[o.point]; });
  std::mt19937 random(5);
  std::normal_distribution<double> noise(0, kSigma);
  const StereoCamera& stereo = scene.points.stereo;
  for (int j = 0; j < 12; ++j) {
    const double side = j % 2 == 0 ? -1 : 1, depth = 3.5 + 0.4 * j;
    const Eigen::Vector3d start(side * 1.2, -0.9 + 0.1 * j, depth);
    const Eigen::Vector3d step = j % 3 == 0   ? Eigen::Vector3d(0.1, 1.5, 0.2)
                                 : j % 3 == 1 ? Eigen::Vector3d(-side * 1.6, 0.3, 0.4)
                                              : Eigen::Vector3d(0.3, 0.8, 1.5);
    const Eigen::Vector3d end = start + step;
    scene.lines.push_back(*PluckerLine::FromPoints(start, end));
    for (int i = 0; i < 5; ++i) {
      const auto shift = [&](Eigen::Vector2d pixel) -> Eigen::Vector2d {
        const double x = noise(random);
        return pixel + Eigen::Vector2d(x, noise(random));
      };
      const auto segment = [&](const Rigid3& cam_from_world) -> ImageSegment {
        return {shift(stereo.camera.Project(cam_from_world * start)),
                shift(stereo.camera.Project(cam_from_world * end))};
      };
      const Rigid3 left = scene.points.poses[i].Inverse();
      const Rigid3 right(left.rotation, left.translation - Eigen::Vector3d(stereo.baseline, 0, 0));
      LineObservation seen{segment(left), segment(right), kSigma};
      const bool is_shifted = scene.seen.size() % 8 == 7;
      if (is_shifted) seen.left.start += Eigen::Vector2d(12, 12);
      scene.seen.push_back({i, j, seen});
      scene.shifted.push_back(is_shifted);
    }
  }
  return scene;
}

BundleProblem Disturbed(const LineScene& scene, bool with_lines) {
  BundleProblem problem;
  problem.stereo = scene.points.stereo;
  problem.world_from_cam = scene.points.poses;
  problem.pose_fixed.assign(problem.world_from_cam.size(), false);
  problem.pose_fixed[0] = true;
  for (std::size_t i = 1; i < problem.world_from_cam.size(); ++i) {
    problem.world_from_cam[i] = Disturb(problem.world_from_cam[i], 0.004, 0.02);
  }
  problem.points_in_world = scene.points.points;
  problem.observations = scene.points.observations;
  if (!with_lines) return problem;
  for (const PluckerLine& line : scene.lines) {
    problem.lines_in_world.push_back(Rigid3(ExpSO3({0.002, 0.003, 0}), {0.01, 0, -0.01}) * line);
  }
  problem.line_observations = scene.seen;
  return problem;
}

double MeanPositionError(const LineScene& scene, const BundleProblem& problem) {
  double sum = 0;
  for (std::size_t i = 1; i < problem.world_from_cam.size(); ++i) {
    sum += (problem.world_from_cam[i].translation - scene.points.poses[i].translation).norm();
  }
  return sum / static_cast<double>(problem.world_from_cam.size() - 1);
}

TEST(SolveBundle, LinesHoldWhatFewPointsLeaveOpen) {
  const LineScene scene = MakeLineScene();
  ASSERT_GE(scene.points.observations.size(), 15u);
  BundleProblem points = Disturbed(scene, false);
  SolveBundle({}, &points);
  BundleProblem both = Disturbed(scene, true);
  const BundleSummary summary = SolveBundle({}, &both);
  EXPECT_LT(MeanPositionError(scene, both), 0.5 * MeanPositionError(scene, points));
  // As near as noise lets it come: a start at the truth ends no nearer.
  BundleProblem from_truth = Disturbed(scene, true);
  from_truth.world_from_cam = scene.points.poses;
  from_truth.lines_in_world = scene.lines;
  SolveBundle({}, &from_truth);
  EXPECT_LT(MeanPositionError(scene, both), MeanPositionError(scene, from_truth) + 0.003);
  EXPECT_GT(summary.line_rms, 0.6);
  EXPECT_LT(summary.line_rms, 1.1);
  // The near upright ones; the ends of level and far ones leave their depth open.
  for (const std::size_t j : {0, 3}) {
    EXPECT_GT(std::abs(both.lines_in_world[j].v.dot(scene.lines[j].v)), std::cos(0.07)) << j;
    EXPECT_LT(both.lines_in_world[j].Distance(scene.lines[j].Closest({0, 0, 5})), 0.05) << j;
  }
}

TEST(SolveBundle, RejectsShiftedLinesAndThoseBehindTheCamera) {
  LineScene scene = MakeLineScene();
  // Its endless line goes through the observed ends, which are those of a stretch behind.
  BundleProblem::LineSeen behind = scene.seen[0];
  const Rigid3 turn(ExpSO3({0, 3.14159265, 0}), {0, 0, 0});
  scene.points.poses.push_back(scene.points.poses[0] * turn);
  behind.pose = 5;
  scene.seen.push_back(behind);
  scene.shifted.push_back(true);
  BundleProblem problem = Disturbed(scene, true);
  problem.pose_fixed[5] = true;
  problem.world_from_cam[5] = scene.points.poses[5];
  const BundleSummary summary = SolveBundle({}, &problem);
  ASSERT_EQ(summary.line_outlier.size(), scene.seen.size());
  for (std::size_t i = 0; i < scene.seen.size(); ++i) {
    EXPECT_EQ(summary.line_outlier[i], scene.shifted[i]) << i;
  }
}

TEST(SolveBundle, RepeatsBitByBitWithLines) {
  const LineScene scene = MakeLineScene();
  BundleProblem first = Disturbed(scene, true);
  SolveBundle({}, &first);
  const std::vector<double> elsewhere(12345);  // moves what is allocated next
  BundleProblem second = Disturbed(scene, true);
  SolveBundle({}, &second);
  for (std::size_t i = 0; i < first.world_from_cam.size(); ++i) {
    EXPECT_EQ(first.world_from_cam[i].ToMatrix(), second.world_from_cam[i].ToMatrix());
  }
  for (std::size_t i = 0; i < first.lines_in_world.size(); ++i) {
    EXPECT_EQ(first.lines_in_world[i].n, second.lines_in_world[i].n);
  }
}

}  // namespace
}  // namespace airslam
