// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/kept_factors.h"

#include <algorithm>

namespace airslam {

int KeptFactors::AddUnknown(std::span<const double> start, const ceres::Manifold* manifold,
                            bool held) {
  const int ambient = static_cast<int>(start.size());
  Unknown unknown{static_cast<int>(start_.size()), ambient, manifold, -1};
  start_.insert(start_.end(), start.begin(), start.end());
  if (!held) {
    unknown.equation = static_cast<int>(sizes_.size());
    sizes_.push_back(manifold != nullptr ? manifold->TangentSize() : ambient);
  }
  unknowns_.push_back(unknown);
  return static_cast<int>(unknowns_.size()) - 1;
}

void KeptFactors::AddFactor(const ceres::CostFunction& factor, std::vector<int> unknowns,
                            Huber loss) {
  if (by_value_.size() < unknowns.size()) {
    by_value_.resize(unknowns.size());
    by_tangent_.resize(unknowns.size());
    by_value_data_.resize(unknowns.size());
    blocks_of_values_.resize(unknowns.size());
  }
  factors_.push_back({&factor, std::move(unknowns), loss});
}

void KeptFactors::AddStructure(ReducedSystem& system) {
  for (const Factor& factor : factors_) {
    for (const int a : factor.unknowns) {
      for (const int b : factor.unknowns) {
        const std::pair<int, int> key(equation(a), equation(b));
        if (key.second < 0 || key.first <= key.second || blocks_.contains(key)) continue;
        blocks_[key] = system.AddBlock(key.first, key.second);
      }
    }
  }
}

double KeptFactors::Evaluate(const Factor& factor, const std::vector<double>& values,
                             bool derivatives) {
  const int rows = factor.function->num_residuals();
  residuals_.resize(rows);
  for (std::size_t k = 0; k < factor.unknowns.size(); ++k) {
    const Unknown& unknown = unknowns_[factor.unknowns[k]];
    blocks_of_values_[k] = values.data() + unknown.offset;
    by_value_data_[k] = nullptr;
    if (!derivatives || unknown.equation < 0) continue;
    by_value_[k].resize(rows, unknown.ambient);
    by_value_data_[k] = by_value_[k].data();
  }
  factor.function->Evaluate(blocks_of_values_.data(), residuals_.data(),
                            derivatives ? by_value_data_.data() : nullptr);
  return residuals_.squaredNorm();
}

void KeptFactors::TangentDerivative(const Factor& factor, const std::vector<double>& values,
                                    int k) {
  const Unknown& unknown = unknowns_[factor.unknowns[k]];
  if (unknown.equation < 0) return;
  if (unknown.manifold == nullptr) {
    by_tangent_[k] = by_value_[k];
    return;
  }
  Jacobian value_by_tangent(unknown.ambient, sizes_[unknown.equation]);
  unknown.manifold->PlusJacobian(values.data() + unknown.offset, value_by_tangent.data());
  by_tangent_[k] = by_value_[k].lazyProduct(value_by_tangent);
}

void KeptFactors::AddToEquations(const Factor& factor, double weight, ReducedSystem& system) {
  const int count = static_cast<int>(factor.unknowns.size());
  for (int a = 0; a < count; ++a) {
    const int row = equation(factor.unknowns[a]);
    if (row < 0) continue;
    system.gradient().segment(system.start(row), system.size(row)).noalias() -=
        weight * by_tangent_[a].transpose().lazyProduct(residuals_);
    for (int b = 0; b < count; ++b) {
      const int column = equation(factor.unknowns[b]);
      if (column < 0 || column > row) continue;
      const int begin = row == column ? system.diagonal(row) : blocks_.at({row, column});
      Eigen::Map<Eigen::MatrixXd>(system.values() + begin, system.size(row), system.size(column)) +=
          weight * by_tangent_[a].transpose().lazyProduct(by_tangent_[b]);
    }
  }
}

double KeptFactors::Cost(const std::vector<double>& values, double weight) {
  double cost = 0;
  for (const Factor& factor : factors_) {
    cost += 0.5 * weight * factor.loss.Cost(Evaluate(factor, values, false));
  }
  return cost;
}

void KeptFactors::Linearize(const std::vector<double>& values, double weight,
                            ReducedSystem& system) {
  for (const Factor& factor : factors_) {
    const double squares = Evaluate(factor, values, true);
    for (std::size_t k = 0; k < factor.unknowns.size(); ++k) {
      TangentDerivative(factor, values, static_cast<int>(k));
    }
    AddToEquations(factor, weight * factor.loss.Weight(squares), system);
  }
}

void KeptFactors::Plus(const std::vector<double>& values, const Eigen::VectorXd& step,
                       const ReducedSystem& system, std::vector<double>* moved) const {
  for (const Unknown& unknown : unknowns_) {
    const double* from = values.data() + unknown.offset;
    double* to = moved->data() + unknown.offset;
    if (unknown.equation < 0) {
      std::copy_n(from, unknown.ambient, to);
      continue;
    }
    const double* by = step.data() + system.start(unknown.equation);
    if (unknown.manifold != nullptr) {
      unknown.manifold->Plus(from, by, to);
    } else {
      for (int i = 0; i < unknown.ambient; ++i) to[i] = from[i] + by[i];
    }
  }
}

}  // namespace airslam
