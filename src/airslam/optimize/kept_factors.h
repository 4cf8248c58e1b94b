// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/cost_function.h>
#include <ceres/manifold.h>

#include <map>
#include <span>
#include <utility>
#include <vector>

#include "airslam/optimize/huber.h"
#include "airslam/optimize/reduced_system.h"

namespace airslam {

// The unknowns of a bundle adjustment that stay when landmarks are eliminated (poses, and what the
// IMU adds), and the factors between them alone: few, so that they are ceres::CostFunction objects.
class KeptFactors {
 public:
  // Adds an unknown and returns its number. Its manifold, null for plain numbers, must outlive
  // this. One that is held takes no part in the equations.
  int AddUnknown(std::span<const double> start, const ceres::Manifold* manifold, bool held);
  // The factor must outlive this. All factors' squares are weighed by the `weight` of the calls
  // below.
  void AddFactor(const ceres::CostFunction& factor, std::vector<int> unknowns, Huber loss = {});

  // Values of all unknowns, one after the other, as they start.
  const std::vector<double>& start() const { return start_; }
  int offset(int unknown) const { return unknowns_[unknown].offset; }  // in the values
  // The unknown's number in the equations, or -1 when it is held.
  int equation(int unknown) const { return unknowns_[unknown].equation; }
  // Sizes of the unknowns in the equations.
  const std::vector<int>& sizes() const { return sizes_; }

  // Once, when all has been added, and before anything else adds blocks: those of the factors.
  void AddStructure(ReducedSystem& system);

  // Half the sum of robust squares at `values`.
  double Cost(const std::vector<double>& values, double weight);
  // Adds the factors to the equations.
  void Linearize(const std::vector<double>& values, double weight, ReducedSystem& system);
  // moved = values + step, along the manifolds.
  void Plus(const std::vector<double>& values, const Eigen::VectorXd& step,
            const ReducedSystem& system, std::vector<double>* moved) const;

 private:
  struct Unknown {
    int offset, ambient;
    const ceres::Manifold* manifold;
    int equation;
  };
  struct Factor {
    const ceres::CostFunction* function;
    std::vector<int> unknowns;
    Huber loss;
  };
  // Evaluates into the scratch below; returns the squared residual.
  double Evaluate(const Factor& factor, const std::vector<double>& values, bool derivatives);
  // Derivatives of the residuals by the tangent of the factor's unknown k, after Evaluate.
  void TangentDerivative(const Factor& factor, const std::vector<double>& values, int k);
  void AddToEquations(const Factor& factor, double weight, ReducedSystem& system);

  std::vector<Unknown> unknowns_;
  std::vector<int> sizes_;
  std::vector<double> start_;
  std::vector<Factor> factors_;
  std::map<std::pair<int, int>, int> blocks_;  // by row and column in the equations
  // Scratch, so that evaluating allocates nothing: residuals, and for each unknown of the factor
  // its value, its derivatives as they come and by the tangent.
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  static constexpr int kMaxSize = 9;  // of residuals and of unknowns
  using Jacobian =
      Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor, kMaxSize, kMaxSize>;
  Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxSize, 1> residuals_;
  std::vector<const double*> blocks_of_values_;
  std::vector<Jacobian> by_value_, by_tangent_;
  std::vector<double*> by_value_data_;
};

}  // namespace airslam
