// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/line_factor.h"

#include <ceres/gradient_checker.h>
#include <ceres/loss_function.h>
#include <ceres/problem.h>
#include <ceres/solver.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

#include "airslam/geometry/line_triangulation.h"
#include "airslam/geometry/so3.h"
#include "airslam/optimize/pose_parameter.h"

namespace airslam {
namespace {

const StereoCamera kStereo{{450, 470, 320, 240, 640, 480}, 0.12};  // fx differs from fy
const Rigid3 kWorldFromCam{Eigen::Quaterniond(0.8, 0.3, -0.4, 0.33), {1.0, -2.0, 0.5}};
const SpaceSegment kInCam{{-0.6, -0.4, 3.2}, {0.7, 0.5, 4.1}};
const LineObservation kMono{{{250, 190}, {390, 300}}, {}, 0.7};
const LineObservation kBoth{{{250, 190}, {390, 300}}, ImageSegment{{225, 180}, {370, 290}}, 0.7};

PluckerLine InWorld(const SpaceSegment& in_cam) {
  return PluckerLine::FromPoints(kWorldFromCam * in_cam.start, kWorldFromCam * in_cam.end).value();
}

ImageSegment Project(const Rigid3& cam_from_world, const SpaceSegment& in_world) {
  return {kStereo.camera.Project(cam_from_world * in_world.start),
          kStereo.camera.Project(cam_from_world * in_world.end)};
}

TEST(LineFactor, ResidualsAreTheSignedDistancesOfTheEnds) {
  const PoseParameter pose = ToParameter(kWorldFromCam);
  const LineParameter line = ToParameter(InWorld(kInCam));
  const double* blocks[] = {pose.data(), line.data()};
  LineObservation seen;
  seen.sigma = 0.5;
  seen.left = Project(Rigid3(), kInCam);
  seen.right = Project(RightFromLeft(kStereo), kInCam);
  double residuals[4];
  ASSERT_TRUE(LineFactor(kStereo, seen).Evaluate(blocks, residuals, nullptr));
  for (const double r : residuals) EXPECT_NEAR(r, 0, 1e-9);
  // Ends moved along the segment change nothing, ends moved across by their distance.
  const Eigen::Vector2d along = (seen.left.end - seen.left.start).normalized();
  const Eigen::Vector2d across(-along.y(), along.x());
  seen.left.start += 30 * along + 2 * across;
  seen.left.end += 10 * along - 3 * across;
  seen.right->end += 4 * Eigen::Vector2d(0, 1);
  ASSERT_TRUE(LineFactor(kStereo, seen).Evaluate(blocks, residuals, nullptr));
  EXPECT_NEAR(std::abs(residuals[0]), 2 / 0.5, 1e-9);
  EXPECT_NEAR(std::abs(residuals[1]), 3 / 0.5, 1e-9);
  EXPECT_LT(residuals[0] * residuals[1], 0);
  EXPECT_NEAR(residuals[2], 0, 1e-9);
  const ImageSegment right = Project(RightFromLeft(kStereo), kInCam);
  const Eigen::Vector2d right_along = (right.end - right.start).normalized();
  EXPECT_NEAR(std::abs(residuals[3]), 4 * right_along.x() / 0.5, 1e-9);
}

TEST(LineFactor, AgreesWithTheGeometry) {
  const PluckerLine line_in_world = InWorld(kInCam);
  const PoseParameter pose = ToParameter(kWorldFromCam);
  const LineParameter line = ToParameter(line_in_world);
  const double* blocks[] = {pose.data(), line.data()};
  double residuals[2];
  ASSERT_TRUE(LineFactor(kStereo, kMono).Evaluate(blocks, residuals, nullptr));
  const PluckerLine line_in_cam = kWorldFromCam.Inverse() * line_in_world;
  EXPECT_NEAR(std::max(std::abs(residuals[0]), std::abs(residuals[1])),
              EndPointError(kStereo.camera, line_in_cam, kMono.left) / 0.7, 1e-9);
}

void CheckGradient(const ceres::CostFunction& factor, std::vector<const double*> blocks) {
  const PoseManifold pose_manifold;
  const LineManifold line_manifold;
  std::vector<const ceres::Manifold*> manifolds = {&pose_manifold};
  if (blocks.size() == 2) manifolds.push_back(&line_manifold);
  ceres::NumericDiffOptions numeric;
  numeric.ridders_relative_initial_step_size = 1e-4;  // small beside every parameter
  const ceres::GradientChecker checker(&factor, &manifolds, numeric);
  ceres::GradientChecker::ProbeResults results;
  checker.Probe(blocks.data(), 1e-6, &results);  // itself, it would compare rounding with zeros
  ASSERT_TRUE(results.return_value) << results.error_log;
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    const double size = results.local_numeric_jacobians[i].norm();
    EXPECT_GT(size, 1) << i;
    EXPECT_LT((results.local_jacobians[i] - results.local_numeric_jacobians[i]).norm(), 1e-8 * size)
        << i << results.error_log;
  }
}

TEST(LineFactor, JacobianOfStereoAndMonocularObservations) {
  const PoseParameter pose = ToParameter(kWorldFromCam);
  for (const SpaceSegment& in_cam :
       {kInCam, SpaceSegment{{-1, 0.2, 3}, {1, 0.2, 3}}, SpaceSegment{{0.3, -1, 2}, {0.3, 1, 9}}}) {
    const LineParameter line = ToParameter(InWorld(in_cam));
    CheckGradient(LineFactor(kStereo, kMono), {pose.data(), line.data()});
    CheckGradient(LineFactor(kStereo, kBoth), {pose.data(), line.data()});
  }
}

TEST(LineFactor, JacobianOfALineThroughTheWorldsOrigin) {
  const PoseParameter pose = ToParameter(kWorldFromCam);
  const PluckerLine line_in_world{Eigen::Vector3d::Zero(),
                                  (kWorldFromCam * kInCam.start).normalized()};
  const LineParameter line = ToParameter(line_in_world);
  CheckGradient(LineFactor(kStereo, kMono), {pose.data(), line.data()});
  CheckGradient(LineFactor(kStereo, kBoth), {pose.data(), line.data()});
}

TEST(LineFactor, LineWithoutAnImageIsAnOutlierWithoutDerivative) {
  const PoseParameter pose = ToParameter(kWorldFromCam);
  const SpaceSegment through_left{{0, 0, 0}, {0.1, 0.2, 1}};
  const SpaceSegment through_right{{0.12, 0, 0}, {0.3, 0.2, 1}};
  for (const SpaceSegment& in_cam : {through_left, through_right}) {
    const LineParameter line = ToParameter(InWorld(in_cam));
    const double* blocks[] = {pose.data(), line.data()};
    double residuals[4], by_pose[28], by_line[24];
    double* jacobians[] = {by_pose, by_line};
    ASSERT_TRUE(LineFactor(kStereo, kBoth).Evaluate(blocks, residuals, jacobians));
    for (double r : residuals) EXPECT_EQ(r, LineFactor::kNoImageResidual);
    for (double j : by_pose) EXPECT_EQ(j, 0);
    for (double j : by_line) EXPECT_EQ(j, 0);
  }
}

// Keyframes on a gentle curve that look at segments in all directions.
struct Scene {
  struct Sighting {
    int pose, line;
    LineObservation seen;
  };
  std::vector<Rigid3> world_from_cam;
  std::vector<SpaceSegment> in_world;
  std::vector<Sighting> sightings;
};

constexpr double kSigma = 0.3;  // pixels

Scene MakeScene(int poses, int lines, double noise_sigma) {
  Scene scene;
  std::mt19937 random(17);
  std::normal_distribution<double> noise(0, 1);
  std::uniform_real_distribution<double> unit(-1, 1);
  const auto move = [&](ImageSegment segment) {
    segment.start += noise_sigma * Eigen::Vector2d(noise(random), noise(random));
    segment.end += noise_sigma * Eigen::Vector2d(noise(random), noise(random));
    return segment;
  };
  for (int i = 0; i < poses; ++i) {
    scene.world_from_cam.emplace_back(ExpSO3({0.01 * i, 0.03 * i, -0.005 * i}),
                                      Eigen::Vector3d(0.2 * i, 0.05 * i * i, 0.05 * i));
  }
  for (int j = 0; j < lines; ++j) {
    const Eigen::Vector3d middle(1.5 * unit(random), unit(random), 4.5 + 1.5 * unit(random));
    const Eigen::Vector3d half =
        0.6 * Eigen::Vector3d(unit(random), unit(random), unit(random)).normalized();
    scene.in_world.push_back({middle - half, middle + half});
    for (int i = 0; i < poses; ++i) {
      const Rigid3 left_from_world = scene.world_from_cam[i].Inverse();
      const ImageSegment left = move(Project(left_from_world, scene.in_world[j]));
      const ImageSegment right =
          move(Project(RightFromLeft(kStereo) * left_from_world, scene.in_world[j]));
      scene.sightings.push_back({i, j, {left, right, kSigma}});
    }
  }
  return scene;
}

// What the bundle moves; the first pose is fixed.
struct Estimate {
  std::vector<PoseParameter> poses;
  std::vector<LineParameter> lines;
};

Estimate Disturb(const Scene& scene) {
  Estimate estimate;
  std::mt19937 random(23);
  std::uniform_real_distribution<double> unit(-1, 1);
  const auto disturbance = [&](double size) {
    return Eigen::Vector3d(size * unit(random), size * unit(random), size * unit(random));
  };
  for (const Rigid3& pose : scene.world_from_cam) {
    const double size = estimate.poses.empty() ? 0 : 1;
    estimate.poses.push_back(
        ToParameter(pose * Rigid3(ExpSO3(disturbance(0.02 * size)), disturbance(0.05 * size))));
  }
  for (const SpaceSegment& segment : scene.in_world) {
    estimate.lines.push_back(ToParameter(
        PluckerLine::FromPoints(segment.start + disturbance(0.1), segment.end + disturbance(0.1))
            .value()));
  }
  return estimate;
}

ceres::Solver::Summary Solve(const Scene& scene, Estimate* estimate) {
  ceres::Problem problem;
  for (const Scene::Sighting& s : scene.sightings) {
    problem.AddResidualBlock(new LineFactor(kStereo, s.seen), nullptr,
                             estimate->poses[s.pose].data(), estimate->lines[s.line].data());
  }
  for (PoseParameter& pose : estimate->poses) problem.SetManifold(pose.data(), new PoseManifold);
  for (LineParameter& line : estimate->lines) problem.SetManifold(line.data(), new LineManifold);
  problem.SetParameterBlockConstant(estimate->poses[0].data());
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.max_num_iterations = 20;
  options.num_threads = 1;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  return summary;
}

struct Errors {
  double position = 0, angle = 0;  // the largest of all poses: metres, radians
  double line = 0;                 // mean over the lines: metres at the worse of the true ends
};

Errors Compare(const Scene& scene, const Estimate& estimate) {
  Errors errors;
  for (std::size_t i = 0; i < scene.world_from_cam.size(); ++i) {
    const Rigid3 error = scene.world_from_cam[i].Inverse() * FromParameter(estimate.poses[i]);
    errors.position = std::max(errors.position, error.translation.norm());
    errors.angle = std::max(errors.angle, error.Angle());
  }
  for (std::size_t j = 0; j < scene.in_world.size(); ++j) {
    const PluckerLine line = LineFromParameter(estimate.lines[j]);
    const SpaceSegment& truth = scene.in_world[j];
    errors.line += std::max(line.Distance(truth.start), line.Distance(truth.end)) /
                   static_cast<double>(scene.in_world.size());
  }
  return errors;
}

TEST(LineFactor, BundleOfLinesIsExactWithoutNoise) {
  const Scene scene = MakeScene(5, 60, 0);
  Estimate estimate = Disturb(scene);
  Solve(scene, &estimate);
  const Errors errors = Compare(scene, estimate);
  EXPECT_LT(errors.position, 1e-5);
  EXPECT_LT(errors.angle, 1e-5);
  EXPECT_LT(errors.line, 1e-5);
}

TEST(LineFactor, BundleOfLinesRecoversPosesAndLinesFromNoise) {
  const Scene scene = MakeScene(5, 60, kSigma);
  Estimate estimate = Disturb(scene);
  const Errors start = Compare(scene, estimate);
  EXPECT_GT(start.position, 0.05);
  EXPECT_GT(start.angle, 0.02);
  EXPECT_GT(start.line, 0.07);
  const ceres::Solver::Summary summary = Solve(scene, &estimate);
  EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE) << summary.BriefReport();
  // The residuals are noise of one sigma: 2 cost / (residuals - degrees of freedom) is near 1.
  const double freedom = summary.num_residuals - 6.0 * 4 - 4.0 * 60;
  EXPECT_NEAR(2 * summary.final_cost / freedom, 1, 0.15);
  const Errors errors = Compare(scene, estimate);
  EXPECT_LT(errors.position, 0.01);
  EXPECT_LT(errors.angle, 0.002);
  EXPECT_LT(errors.line, 0.03);
}

}  // namespace
}  // namespace airslam
