// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/reduced_system.h"

#include <algorithm>

namespace airslam {

ReducedSystem::ReducedSystem(std::span<const int> sizes, bool sparse)
    : sparse_(sparse), sizes_(sizes.begin(), sizes.end()), starts_{0} {
  int begin = 0;
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    blocks_.push_back({{static_cast<int>(i), static_cast<int>(i), begin}});
    begin += sizes[i] * sizes[i];
    starts_.push_back(starts_.back() + sizes[i]);
  }
  values_.resize(begin);
  b_.setZero(rows());
}

int ReducedSystem::AddBlock(int row, int column) {
  const int begin = static_cast<int>(values_.size());
  blocks_[row].push_back({row, column, begin});
  values_.resize(begin + sizes_[row] * sizes_[column]);
  return begin;
}

void ReducedSystem::FinishStructure() {
  if (rows() == 0) return;
  if (sparse_) {
    MakeSparseStructure();
  } else {
    dense_.setZero(rows(), rows());
    dense_cholesky_ = Eigen::LLT<Eigen::MatrixXd>(rows());
  }
}

void ReducedSystem::MakeSparseStructure() {
  std::vector<Eigen::Triplet<double>> entries;
  ForEachBlock([&](const Block& block) {
    for (int c = 0; c < sizes_[block.column]; ++c) {
      for (int r = FirstRow(block, c); r < sizes_[block.row]; ++r) {
        entries.emplace_back(starts_[block.row] + r, starts_[block.column] + c, 1.0);
      }
    }
  });
  lower_.resize(rows(), rows());
  lower_.setFromTriplets(entries.begin(), entries.end());
  ForEachBlock([&](const Block& block) {
    for (int c = 0; c < sizes_[block.column]; ++c) {
      const int column = starts_[block.column] + c;
      const int* begin = lower_.innerIndexPtr() + lower_.outerIndexPtr()[column];
      const int* end = lower_.innerIndexPtr() + lower_.outerIndexPtr()[column + 1];
      const int* found = std::lower_bound(begin, end, starts_[block.row] + FirstRow(block, c));
      lower_positions_.push_back(static_cast<int>(found - lower_.innerIndexPtr()));
    }
  });
  sparse_cholesky_.analyzePattern(lower_);
}

void ReducedSystem::SetZero() {
  std::fill(values_.begin(), values_.end(), 0.0);
  b_.setZero();
}

bool ReducedSystem::Solve(const Eigen::VectorXd& damping, Eigen::VectorXd* x) {
  if (rows() == 0) {
    x->resize(0);
    return true;
  }
  return sparse_ ? SolveSparse(damping, x) : SolveDense(damping, x);
}

bool ReducedSystem::SolveDense(const Eigen::VectorXd& damping, Eigen::VectorXd* x) {
  ForEachBlock([&](const Block& block) {
    const int height = sizes_[block.row], width = sizes_[block.column];
    dense_.block(starts_[block.row], starts_[block.column], height, width) =
        Eigen::Map<const Eigen::MatrixXd>(values_.data() + block.begin, height, width);
  });
  dense_.diagonal() += damping;
  dense_cholesky_.compute(dense_);
  if (dense_cholesky_.info() != Eigen::Success) return false;
  *x = b_;
  dense_cholesky_.solveInPlace(*x);
  return true;
}

bool ReducedSystem::SolveSparse(const Eigen::VectorXd& damping, Eigen::VectorXd* x) {
  const int* position = lower_positions_.data();
  ForEachBlock([&](const Block& block) {
    const double* column = values_.data() + block.begin;
    const int height = sizes_[block.row];
    for (int c = 0; c < sizes_[block.column]; ++c, column += height) {
      const int first = FirstRow(block, c);
      std::copy(column + first, column + height, lower_.valuePtr() + *position++);
    }
  });
  for (int i = 0; i < rows(); ++i) {
    lower_.valuePtr()[lower_.outerIndexPtr()[i]] += damping[i];  // the diagonal comes first
  }
  sparse_cholesky_.factorize(lower_);
  if (sparse_cholesky_.info() != Eigen::Success) return false;
  *x = sparse_cholesky_.solve(b_);
  return true;
}

}  // namespace airslam
