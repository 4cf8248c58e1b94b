// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/bundle_solver.h"

#include <ceres/loss_function.h>
#include <ceres/normal_prior.h>
#include <ceres/problem.h>
#include <ceres/solver.h>
#include <gtest/gtest.h>

#include <limits>
#include <memory>
#include <random>

#include "airslam/geometry/so3.h"
#include "airslam/optimize/inertial_bundle.h"
#include "airslam/optimize/line_factor.h"
#include "airslam/optimize/point_factor.h"
#include "airslam/optimize/relative_pose_factor.h"
#include "airslam/sensor/imu_buffer.h"
#include "airslam/testing/synthetic_motion.h"

namespace airslam {
namespace {

constexpr double kHuber = 1.5;
constexpr double kKeptWeight = 0.7;
const StereoCamera kStereo{{450, 455, 320, 240, 640, 480}, 0.12};

// A random bundle: keyframes on a curve, points and lines before them, noise, some wrong
// observations, everything started beside the truth. The first pose is held.
struct Scene {
  std::vector<PoseParameter> poses;
  std::vector<bool> held;
  std::vector<Eigen::Vector3d> points;
  std::vector<LineParameter> lines;
  std::vector<PointSeen> points_seen;
  std::vector<LineSeen> lines_seen;
  std::vector<std::unique_ptr<RelativePoseFactor>> loops;
  std::vector<std::pair<int, int>> loop_ends;
  InertialTerms inertial;
};

class SceneMaker {
 public:
  SceneMaker(unsigned seed, std::vector<Rigid3> truth) : random_(seed), truth_(std::move(truth)) {
    for (const Rigid3& pose : truth_) {
      const bool held = scene.poses.empty();
      const double size = held ? 0 : 1;
      const Rigid3 error(ExpSO3(0.004 * size * Random3()), 0.02 * size * Random3());
      scene.poses.push_back(ToParameter(pose * error));
      scene.held.push_back(held);
    }
  }

  // Each point is seen by two keyframes at least, by the first of them in both images, so that its
  // place is determined.
  void AddPoints(int count) {
    while (count > 0) {
      const Eigen::Vector3d point = InSight();
      std::vector<PointSeen> seen_by;
      for (int i = 0; i < static_cast<int>(truth_.size()); ++i) {
        const Eigen::Vector3d p = truth_[i].Inverse() * point;
        if (p.z() < 0.5 || !kStereo.camera.Contains(kStereo.camera.Project(p))) continue;
        const Eigen::Vector2d pixel = Seen(p);
        const bool wrong = unit_(random_) > 0.9, mono = !seen_by.empty() && unit_(random_) > 0;
        PointObservation seen{pixel, pixel.x() - kStereo.Disparity(p.z()) + noise_(random_), 0.4};
        if (wrong) seen.pixel.x() += 8;
        if (mono) seen.right_x = -1;
        seen_by.push_back({i, static_cast<int>(scene.points.size()), seen});
      }
      if (seen_by.size() < 2) continue;
      scene.points.push_back(point + 0.05 * Random3());
      scene.points_seen.insert(scene.points_seen.end(), seen_by.begin(), seen_by.end());
      --count;
    }
  }

  void AddLines(int count) {
    for (int j = 0; j < count; ++j) {
      const Eigen::Vector3d start = InSight(), end = start + Random3().normalized();
      const Rigid3 error(ExpSO3(0.01 * Random3()), 0.02 * Random3());
      scene.lines.push_back(ToParameter(error * *PluckerLine::FromPoints(start, end)));
      for (int i = 0; i < static_cast<int>(truth_.size()); ++i) {
        const Rigid3 left = truth_[i].Inverse();
        if ((left * start).z() < 0.5 || (left * end).z() < 0.5) continue;
        const Eigen::Vector3d shift(kStereo.baseline, 0, 0);
        LineObservation seen{{Seen(left * start), Seen(left * end)}, std::nullopt, 0.7};
        if (unit_(random_) > -0.3) {
          seen.right = {Seen(left * start - shift), Seen(left * end - shift)};
        }
        scene.lines_seen.push_back({i, j, seen});
      }
    }
  }

  void AddLoop(int from, int to) {
    scene.loops.push_back(std::make_unique<RelativePoseFactor>(RelativePose{
        from, to,
        truth_[from].Inverse() * truth_[to] * Rigid3(ExpSO3(0.01 * Random3()), 0.02 * Random3()),
        1e-4 * Matrix6d::Identity()}));
    scene.loop_ends.emplace_back(from, to);
  }

  Scene scene;

 private:
  Eigen::Vector3d Random3() { return {unit_(random_), unit_(random_), unit_(random_)}; }
  // Before one of the keyframes.
  Eigen::Vector3d InSight() {
    const auto i = static_cast<std::size_t>(0.4999 * (1 + unit_(random_)) *
                                            static_cast<double>(truth_.size()));
    const double z = 4 + 2 * unit_(random_);
    return truth_[i] * Eigen::Vector3d(0.6 * z * unit_(random_), 0.45 * z * unit_(random_), z);
  }
  Eigen::Vector2d Seen(const Eigen::Vector3d& point_in_cam) {
    const double x = noise_(random_);
    return kStereo.camera.Project(point_in_cam) + Eigen::Vector2d(x, noise_(random_));
  }

  std::mt19937 random_;
  std::uniform_real_distribution<double> unit_{-1, 1};
  std::normal_distribution<double> noise_{0, 0.3};
  std::vector<Rigid3> truth_;
};

std::vector<Rigid3> Curve(int poses) {
  std::vector<Rigid3> curve;
  for (int i = 0; i < poses; ++i) {
    curve.emplace_back(ExpSO3({0.01 * i, 0.03 * i, -0.005 * i}),
                       Eigen::Vector3d(0.2 * i, 0.02 * i * i, 0.05 * i));
  }
  return curve;
}

// The scene in the solver.
class Solved {
 public:
  Solved(const Scene& scene, bool sparse)
      : inertial_(scene.inertial),
        solver_({kStereo, scene.points, scene.lines, scene.points_seen, scene.lines_seen, sparse},
                Kept(scene)) {}

  BundleSolver& solver() { return solver_; }
  static BundleSolver::Rules ToTheEnd() {
    return {.max_iterations = 1000,
            .function_tolerance = 1e-15,
            .point_loss = {kHuber},
            .line_loss = {kHuber},
            .kept_weight = kKeptWeight};
  }
  InertialTerms InertialResult(InertialTerms terms) {
    inertial_.CopyTo([&](int unknown) { return solver_.kept(unknown); }, terms);
    return terms;
  }

 private:
  KeptFactors Kept(const Scene& scene) {
    KeptFactors kept;
    for (std::size_t i = 0; i < scene.poses.size(); ++i) {
      kept.AddUnknown(scene.poses[i], &manifold_, scene.held[i]);
    }
    inertial_.AddTo(kept);
    for (std::size_t i = 0; i < scene.loops.size(); ++i) {
      kept.AddFactor(*scene.loops[i], {scene.loop_ends[i].first, scene.loop_ends[i].second}, {3.5});
    }
    return kept;
  }

  PoseManifold manifold_;
  InertialBundle inertial_;
  BundleSolver solver_;
};

// The same scene in Ceres, factor by factor, with Ceres' own losses.
class CeresReference {
 public:
  explicit CeresReference(Scene& scene) : scene_(scene) {
    ceres::Problem::Options ownership;
    ownership.cost_function_ownership = ceres::TAKE_OWNERSHIP;
    ownership.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    problem_ = std::make_unique<ceres::Problem>(ownership);
    for (const PointSeen& o : scene.points_seen) {
      problem_->AddResidualBlock(new PointFactor(kStereo, o.seen), &huber_,
                                 scene.poses[o.pose].data(), scene.points[o.point].data());
    }
    for (const LineSeen& o : scene.lines_seen) {
      problem_->AddResidualBlock(new LineFactor(kStereo, o.seen), &huber_,
                                 scene.poses[o.pose].data(), scene.lines[o.line].data());
    }
    for (LineParameter& line : scene.lines) {
      if (problem_->HasParameterBlock(line.data())) {
        problem_->SetManifold(line.data(), new LineManifold);
      }
    }
    AddInertial();
    for (std::size_t i = 0; i < scene.loops.size(); ++i) {
      problem_->AddResidualBlock(scene.loops[i].release(), &loop_loss_,
                                 scene.poses[scene.loop_ends[i].first].data(),
                                 scene.poses[scene.loop_ends[i].second].data());
    }
    for (std::size_t i = 0; i < scene.poses.size(); ++i) {
      problem_->AddParameterBlock(scene.poses[i].data(), 7, new PoseManifold);
      if (scene.held[i]) problem_->SetParameterBlockConstant(scene.poses[i].data());
    }
  }

  double Solve() {
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::DENSE_SCHUR;
    options.max_num_iterations = 1000;
    options.function_tolerance = 1e-15;
    options.parameter_tolerance = 1e-15;
    options.gradient_tolerance = 1e-14;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, problem_.get(), &summary);
    return summary.final_cost;
  }

  double Cost() {
    double cost = 0;
    problem_->Evaluate({}, &cost, nullptr, nullptr, nullptr);
    return cost;
  }

  Eigen::Vector3d velocity(int state) const { return velocities_[state]; }
  ImuBias bias(int state) const { return FromParameter(biases_[state]); }
  Eigen::Vector3d gravity() const { return gravity_; }

 private:
  void AddInertial() {
    const InertialTerms& terms = scene_.inertial;
    gravity_ = terms.gravity_in_world;
    for (const InertialTerms::State& state : terms.states) {
      velocities_.push_back(state.velocity_in_world);
      biases_.push_back(ToParameter(state.bias));
    }
    for (const InertialTerms::Link& link : terms.links) {
      const ImuPreintegration& readings = *link.readings;
      problem_->AddResidualBlock(new InertialFactor(readings, terms.body_from_cam), &motion_loss_,
                                 scene_.poses[terms.states[link.from].pose].data(),
                                 velocities_[link.from].data(), biases_[link.from].data(),
                                 scene_.poses[terms.states[link.to].pose].data(),
                                 velocities_[link.to].data(), gravity_.data());
      problem_->AddResidualBlock(new BiasWalkFactor(readings.noise(), readings.duration()),
                                 &plain_loss_, biases_[link.from].data(), biases_[link.to].data());
    }
    for (const InertialTerms::BiasPrior& prior : terms.priors) {
      const double sigma = std::sqrt(prior.covariance(0, 0));  // a multiple of the identity here
      problem_->AddResidualBlock(
          new ceres::NormalPrior(Eigen::MatrixXd::Identity(6, 6) / sigma, Eigen::VectorXd::Zero(6)),
          &plain_loss_, biases_[prior.state].data());
    }
    if (terms.gravity_sigma > 0) {
      const double weight = 1 / (terms.gravity_sigma * gravity_.norm());
      problem_->AddResidualBlock(
          new ceres::NormalPrior(weight * Eigen::MatrixXd::Identity(3, 3), gravity_), &plain_loss_,
          gravity_.data());
      problem_->SetManifold(gravity_.data(), new GravityManifold);
    } else if (!terms.links.empty()) {
      problem_->SetParameterBlockConstant(gravity_.data());
    }
  }

  Scene& scene_;
  ceres::HuberLoss huber_{kHuber};
  ceres::ScaledLoss loop_loss_{new ceres::HuberLoss(3.5), kKeptWeight, ceres::TAKE_OWNERSHIP};
  ceres::ScaledLoss motion_loss_{new ceres::HuberLoss(4.1), kKeptWeight, ceres::TAKE_OWNERSHIP};
  ceres::ScaledLoss plain_loss_{nullptr, kKeptWeight, ceres::TAKE_OWNERSHIP};
  std::vector<Eigen::Vector3d> velocities_;
  std::vector<BiasParameter> biases_;
  Eigen::Vector3d gravity_ = Eigen::Vector3d::Zero();
  std::unique_ptr<ceres::Problem> problem_;
};

// The distance of two lists of numbers, relative to their size.
template <class A, class B>
double Difference(const A& a, const B& b, int size) {
  const Eigen::Map<const Eigen::VectorXd> x(a, size), y(b, size);
  return (x - y).norm() / std::max(1.0, y.norm());
}

// Both solvers from the same start to their minima.
void ExpectTheSameMinimum(Scene scene, bool sparse) {
  Solved ours(scene, sparse);
  Scene reference_scene = std::move(scene);
  CeresReference reference(reference_scene);
  const BundleSolver::Rules rules = Solved::ToTheEnd();
  EXPECT_NEAR(ours.solver().Cost(rules), reference.Cost(), 1e-9 * reference.Cost());
  const int steps = ours.solver().Solve(rules);
  // The loops' factors belong to Ceres now, but live.
  const double cost = reference.Solve();
  EXPECT_LT(steps, rules.max_iterations);
  EXPECT_NEAR(ours.solver().Cost(rules), cost, 1e-9 * cost);
  for (std::size_t i = 0; i < reference_scene.poses.size(); ++i) {
    EXPECT_LT(
        Difference(ours.solver().kept(static_cast<int>(i)), reference_scene.poses[i].data(), 7),
        1e-6)
        << i;
  }
  for (std::size_t i = 0; i < reference_scene.points.size(); ++i) {
    EXPECT_LT(Difference(ours.solver().point_in_world(static_cast<int>(i)).data(),
                         reference_scene.points[i].data(), 3),
              1e-6)
        << i;
  }
  for (std::size_t i = 0; i < reference_scene.lines.size(); ++i) {
    EXPECT_LT(Difference(ours.solver().line_in_world(static_cast<int>(i)).data(),
                         reference_scene.lines[i].data(), 6),
              1e-6)
        << i;
  }
  const InertialTerms inertial = ours.InertialResult(reference_scene.inertial);
  const double gravity = reference.gravity().norm();  // what accelerometer biases are small beside
  for (std::size_t i = 0; i < inertial.states.size(); ++i) {
    const InertialTerms::State& state = inertial.states[i];
    const ImuBias bias = reference.bias(static_cast<int>(i));
    const Eigen::Vector3d velocity = reference.velocity(static_cast<int>(i));
    EXPECT_LT((state.velocity_in_world - velocity).norm(), 1e-6 * velocity.norm()) << i;
    EXPECT_LT((state.bias.gyroscope - bias.gyroscope).norm(), 1e-6) << i;
    EXPECT_LT((state.bias.accelerometer - bias.accelerometer).norm(), 1e-6 * gravity) << i;
  }
  EXPECT_LE((inertial.gravity_in_world - reference.gravity()).norm(), 1e-6 * gravity);
}

TEST(BundleSolver, EndsWhereCeresDoesWithPoints) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    SceneMaker maker(seed, Curve(6));
    maker.AddPoints(80);
    ExpectTheSameMinimum(std::move(maker.scene), false);
  }
}

TEST(BundleSolver, EndsWhereCeresDoesWithPointsLinesAndLoops) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    SceneMaker maker(seed, Curve(7));
    maker.AddPoints(60);
    maker.AddLines(15);
    maker.AddLoop(1, 6);
    maker.AddLoop(5, 0);
    ExpectTheSameMinimum(std::move(maker.scene), seed % 2 == 0);
  }
}

// A keyframe every 0.4 s of the synthetic motion, with the IMU between them.
Scene InertialScene(unsigned seed, double gravity_sigma) {
  constexpr std::int64_t kStart = 1'700'000'000'000'000'000, kStep = 400'000'000;
  constexpr int kKeyframes = 6;
  const Rigid3 body_from_cam{Eigen::Quaterniond(0.7, -0.1, 0.2, 0.68), {0.06, -0.02, 0.1}};
  const ImuNoise noise{2e-4, 2e-5, 2e-3, 3e-3, 200};
  const SyntheticTrajectory motion =
      SyntheticTrajectory::Loop(10, 3).Mount(Eigen::Quaterniond(0.5, 0.5, -0.5, 0.5), kStart);
  ImuSimulationOptions options;
  options.noise = noise;
  options.gyroscope_bias = {0.01, -0.02, 0.03};
  options.accelerometer_bias = {0.1, 0.2, -0.1};
  const ImuBuffer buffer(SimulateImu(motion, kStart, kStart + kKeyframes * kStep, options).samples,
                         {});
  std::vector<Rigid3> truth;
  InertialTerms terms;
  terms.body_from_cam = body_from_cam;
  terms.gravity_in_world = ExpSO3({0.01, -0.02, 0}) * kGravityInWorld;
  terms.gravity_sigma = gravity_sigma;
  terms.priors.push_back({0, {}, 0.04 * Matrix6d::Identity()});
  for (int i = 0; i < kKeyframes; ++i) {
    const std::int64_t time = kStart + i * kStep;
    truth.push_back(motion.At(time).world_from_body * body_from_cam);
    terms.states.push_back({i, motion.At(time).velocity_in_world, {}});
    if (i == 0) continue;
    terms.links.push_back({i - 1, i,
                           std::make_shared<const ImuPreintegration>(
                               buffer.Between(time - kStep, time).samples, noise, ImuBias{})});
  }
  SceneMaker maker(seed, truth);
  maker.AddPoints(100);
  maker.AddLines(8);
  maker.scene.inertial = terms;
  return std::move(maker.scene);
}

TEST(BundleSolver, EndsWhereCeresDoesWithTheImu) {
  for (unsigned seed = 1; seed <= 3; ++seed) {
    ExpectTheSameMinimum(InertialScene(seed, 0), false);
    ExpectTheSameMinimum(InertialScene(seed, 0.05), false);
    ExpectTheSameMinimum(InertialScene(seed, 0.05), true);
  }
}

TEST(BundleSolver, OnlyOnePoseMoves) {
  SceneMaker maker(3, Curve(4));
  maker.AddPoints(50);
  maker.AddLines(5);
  maker.scene.held = {true, true, false, true};
  ExpectTheSameMinimum(std::move(maker.scene), false);
}

TEST(BundleSolver, AllPosesAreHeld) {
  SceneMaker maker(4, Curve(4));
  maker.AddPoints(50);
  maker.AddLines(5);
  maker.scene.held = {true, true, true, true};
  ExpectTheSameMinimum(std::move(maker.scene), false);
}

TEST(BundleSolver, NoLandmarks) {
  for (const bool sparse : {false, true}) {
    SceneMaker maker(5, Curve(4));
    for (int i = 1; i < 4; ++i) maker.AddLoop(i - 1, i);
    maker.AddLoop(0, 3);
    ExpectTheSameMinimum(std::move(maker.scene), sparse);
  }
}

// Ceres' rows and ours must be summed alike where a pose sees a landmark in two places.
TEST(BundleSolver, APoseSeesALandmarkTwice) {
  SceneMaker maker(6, Curve(5));
  maker.AddPoints(60);
  maker.AddLines(6);
  Scene& scene = maker.scene;
  const std::size_t points = scene.points_seen.size(), lines = scene.lines_seen.size();
  for (std::size_t i = 0; i < points; i += 3) {
    PointSeen again = scene.points_seen[i];
    again.seen.pixel += Eigen::Vector2d(0.5, -0.2);
    scene.points_seen.push_back(again);
  }
  for (std::size_t i = 0; i < lines; i += 4) scene.lines_seen.push_back(scene.lines_seen[i]);
  ExpectTheSameMinimum(std::move(scene), false);
}

// What cannot be seen, or only once, neither stops the solver nor moves the rest.
TEST(BundleSolver, LandmarksThatSayNothing) {
  SceneMaker maker(7, Curve(5));
  maker.AddPoints(60);
  Solved plain(maker.scene, false);
  Scene& scene = maker.scene;
  const int first = static_cast<int>(scene.points.size());
  const Eigen::Vector3d behind(0, 0, -5), once(0.3, 0.2, 4);
  scene.points.insert(scene.points.end(), {behind, once, once});
  for (int i = 0; i < 5; ++i) {
    scene.points_seen.push_back({i, first, {{300, 200}, 290, 0.4}});
  }
  scene.points_seen.push_back({0, first + 1, {{330, 250}, -1, 0.4}});  // seen once, without a depth
  Solved both(scene, false);                                           // the last is not seen
  const BundleSolver::Rules rules = Solved::ToTheEnd();
  EXPECT_LT(plain.solver().Solve(rules), rules.max_iterations);
  EXPECT_LT(both.solver().Solve(rules), rules.max_iterations);
  for (int i = 0; i < 5; ++i) {
    EXPECT_LT(Difference(both.solver().kept(i), plain.solver().kept(i), 7), 1e-6) << i;
  }
  EXPECT_EQ(both.solver().point_in_world(first), behind);
  EXPECT_EQ(both.solver().point_in_world(first + 2), once);
  // The one seen once comes to lie on its ray.
  const std::vector<double> errors = both.solver().PointErrors();
  EXPECT_LT(errors.back(), 1e-9);
  const double squared_behind = PointResidual::kBehindResidual * PointResidual::kBehindResidual;
  EXPECT_DOUBLE_EQ(errors[errors.size() - 2], 3 * squared_behind);
}

// Outliers weigh nothing: the result is that of a scene without them.
TEST(BundleSolver, OutliersAreLeftOut) {
  SceneMaker maker(8, Curve(5));
  maker.AddPoints(60);
  maker.AddLines(6);
  const Scene& all = maker.scene;
  std::vector<bool> points, lines;
  std::vector<PointSeen> points_left;
  std::vector<LineSeen> lines_left;
  for (std::size_t i = 0; i < all.points_seen.size(); ++i) {
    points.push_back(i % 7 == 0);
    if (!points.back()) points_left.push_back(all.points_seen[i]);
  }
  for (std::size_t i = 0; i < all.lines_seen.size(); ++i) {
    lines.push_back(i % 5 == 0);
    if (!lines.back()) lines_left.push_back(all.lines_seen[i]);
  }
  Solved marked(all, false);
  marked.solver().SetOutliers(points, lines);
  Scene left{all.poses, all.held, all.points, all.lines, points_left, lines_left, {}, {}, {}};
  Solved without(left, false);
  marked.solver().Solve(Solved::ToTheEnd());
  without.solver().Solve(Solved::ToTheEnd());
  for (int i = 0; i < 5; ++i) {
    EXPECT_LT(Difference(marked.solver().kept(i), without.solver().kept(i), 7), 1e-12) << i;
  }
}

// A start that no step improves is kept.
TEST(BundleSolver, NumbersThatAreNoneStopIt) {
  SceneMaker maker(9, Curve(3));
  maker.AddPoints(20);
  maker.scene.points[3].x() = std::numeric_limits<double>::quiet_NaN();
  Solved solved(maker.scene, false);
  solved.solver().Solve(Solved::ToTheEnd());
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(Difference(solved.solver().kept(i), maker.scene.poses[i].data(), 7), 0) << i;
  }
}

}  // namespace
}  // namespace airslam
