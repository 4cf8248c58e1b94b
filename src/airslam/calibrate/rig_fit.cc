// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/calibrate/rig_fit.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>

namespace airslam {
namespace {

constexpr int kIterations = 12;
constexpr double kLeastScale = 0.05;  // pixels: what sub-pixel alignment reaches at best
constexpr double kCutSigmas = 3;

// About 0, and the step of numeric derivatives.
struct Prior {
  double sigma, step;
};
Prior PriorOf(int parameter) {
  if (parameter < 5) return {0.05, 1e-5};
  if (parameter < 11) return {0.3, 1e-4};
  return {0.2, 1e-4};
}

std::vector<int> FreeParameters(const FreeParts& parts) {
  std::vector<int> free;
  for (int i = 0; i < RigCorrection::kParameters; ++i) {
    const bool is_free = i < 5 ? parts.turn : i < 11 ? parts.radial : parts.delay;
    if (is_free) free.push_back(i);
  }
  return free;
}

double RobustScale(const std::vector<double>& errors) {
  return std::max(kLeastScale, 1.4826 * AbsoluteQuantile(errors, 0.5));
}

std::vector<double> ErrorsOf(const EpipolarGeometry& geometry,
                             const std::vector<RayMatch>& matches) {
  std::vector<double> errors(matches.size());
  for (std::size_t i = 0; i < matches.size(); ++i) errors[i] = geometry.Error(matches[i]).pixels;
  return errors;
}

// The linear system of one step; `information` is that of the free parameters, in 1 / pixels^2.
struct NormalEquations {
  Eigen::MatrixXd information;
  Eigen::VectorXd gradient;
};

NormalEquations Linearize(const StereoRig& rig, const std::vector<RayMatch>& matches,
                          const std::vector<int>& free, const RigCorrection& at,
                          const std::vector<double>& errors, double scale) {
  const auto n = static_cast<Eigen::Index>(free.size());
  Eigen::MatrixXd jacobian(static_cast<Eigen::Index>(matches.size()), n);
  for (Eigen::Index k = 0; k < n; ++k) {
    const int parameter = free[static_cast<std::size_t>(k)];
    const double step = PriorOf(parameter).step;
    RigCorrection plus = at, minus = at;
    plus.at(parameter) += step;
    minus.at(parameter) -= step;
    const EpipolarGeometry above(rig, plus), below(rig, minus);
    for (std::size_t i = 0; i < matches.size(); ++i) {
      jacobian(static_cast<Eigen::Index>(i), k) =
          (above.Error(matches[i]).pixels - below.Error(matches[i]).pixels) / (2 * step);
    }
  }
  NormalEquations result{Eigen::MatrixXd::Zero(n, n), Eigen::VectorXd::Zero(n)};
  for (std::size_t i = 0; i < matches.size(); ++i) {
    const double weight = 1 / (1 + std::pow(errors[i] / (2 * scale), 2));
    const auto row = jacobian.row(static_cast<Eigen::Index>(i));
    result.information += weight * row.transpose() * row;
    result.gradient += weight * row.transpose() * errors[i];
  }
  RigCorrection prior = at;
  for (Eigen::Index k = 0; k < n; ++k) {
    const int parameter = free[static_cast<std::size_t>(k)];
    const double weight = std::pow(scale / PriorOf(parameter).sigma, 2);
    result.information(k, k) += weight;
    result.gradient[k] += weight * prior.at(parameter);
  }
  return result;
}

}  // namespace

double AbsoluteQuantile(std::span<const double> values, double p) {
  if (values.empty()) return 0;
  std::vector<double> magnitudes;
  for (const double value : values) magnitudes.push_back(std::abs(value));
  const auto at = magnitudes.begin() +
                  static_cast<std::ptrdiff_t>(p * static_cast<double>(magnitudes.size() - 1) + 0.5);
  std::nth_element(magnitudes.begin(), at, magnitudes.end());
  return *at;
}

double RigFit::Cost(double sigma_pixels) const {
  constexpr double kWorst = kCutSigmas * kCutSigmas;
  if (pixels.empty()) return kWorst;
  double sum = 0;
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    const bool behind = parallax[i] < -kCutSigmas * sigma_pixels;
    sum += behind ? kWorst : std::min(kWorst, std::pow(pixels[i] / sigma_pixels, 2));
  }
  return sum / static_cast<double>(pixels.size());
}

double RigFit::BehindShare(double sigma_pixels) const {
  int behind = 0, telling = 0;
  for (const double value : parallax) {
    if (std::abs(value) <= kCutSigmas * sigma_pixels) continue;
    ++telling;
    behind += value < 0;
  }
  return telling > 0 ? static_cast<double>(behind) / telling : 0;
}

RigFit FitRig(const StereoRig& rig, std::span<const RayMatch> matches, const FreeParts& parts) {
  std::vector<RayMatch> chosen;
  std::copy_if(matches.begin(), matches.end(), std::back_inserter(chosen),
               [](const RayMatch& match) { return match.valid; });
  const std::vector<int> free = FreeParameters(parts);
  RigFit fit;
  fit.pixels = ErrorsOf(EpipolarGeometry(rig, fit.correction), chosen);
  for (int iteration = 0; iteration < kIterations && !free.empty() && !chosen.empty();
       ++iteration) {
    const double scale = RobustScale(fit.pixels);
    const NormalEquations step = Linearize(rig, chosen, free, fit.correction, fit.pixels, scale);
    const Eigen::LDLT<Eigen::MatrixXd> solver(step.information);
    const Eigen::VectorXd change = -solver.solve(step.gradient);
    const Eigen::MatrixXd inverse =
        solver.solve(Eigen::MatrixXd::Identity(step.information.rows(), step.information.cols()));
    for (std::size_t k = 0; k < free.size(); ++k) {
      const auto i = static_cast<Eigen::Index>(k);
      fit.correction.at(free[k]) += change[i];
      fit.sigma.at(free[k]) = scale * std::sqrt(std::max(0.0, inverse(i, i)));
    }
    fit.pixels = ErrorsOf(EpipolarGeometry(rig, fit.correction), chosen);
  }
  const EpipolarGeometry geometry(rig, fit.correction);
  for (const RayMatch& match : chosen) fit.parallax.push_back(geometry.Error(match).parallax);
  fit.noise = RobustScale(fit.pixels);
  return fit;
}

double SystematicError(const RigFit& before, const RigFit& after) {
  std::vector<double> moved;
  for (std::size_t i = 0; i < std::min(before.pixels.size(), after.pixels.size()); ++i) {
    if (std::abs(after.pixels[i]) > kCutSigmas * after.noise) continue;
    moved.push_back(before.pixels[i] - after.pixels[i]);
  }
  return AbsoluteQuantile(moved, 0.9);
}

}  // namespace airslam
