// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <span>
#include <vector>

namespace airslam {

// The normal equations (H + D) x = b of the unknowns that are left when landmarks have been
// eliminated: H symmetric and positive definite in blocks, one row of blocks an unknown, of which
// the lower triangle is kept, each block by itself (column-major); D diagonal. Which blocks there
// are is told once. Solved by Cholesky decomposition, dense or sparse.
class ReducedSystem {
 public:
  // sizes: of the unknowns. The blocks on the diagonal are there from the beginning.
  ReducedSystem(std::span<const int> sizes, bool sparse);

  // A block, by its unknowns, and where it begins in values().
  struct Block {
    int row, column;
    int begin;
  };
  // Adds a block below the diagonal (row > column), once, and returns where it begins.
  int AddBlock(int row, int column);
  // No block may be added after this, and all else needs it.
  void FinishStructure();

  // The blocks of one row; that on the diagonal is the first.
  const std::vector<Block>& row(int unknown) const { return blocks_[unknown]; }
  int diagonal(int unknown) const { return blocks_[unknown].front().begin; }
  int start(int unknown) const { return starts_[unknown]; }  // its first row in x and b
  int size(int unknown) const { return sizes_[unknown]; }
  int rows() const { return starts_.back(); }

  void SetZero();
  double* values() {
    return values_.data();
  }  // of H's blocks; of those on the diagonal the lower
     // triangles are read
  Eigen::VectorXd& gradient() { return b_; }
  // False when H + D is not positive definite.
  bool Solve(const Eigen::VectorXd& damping, Eigen::VectorXd* x);

 private:
  bool SolveDense(const Eigen::VectorXd& damping, Eigen::VectorXd* x);
  bool SolveSparse(const Eigen::VectorXd& damping, Eigen::VectorXd* x);
  void MakeSparseStructure();
  template <class Visit>
  void ForEachBlock(const Visit& visit) const {
    for (const std::vector<Block>& row : blocks_) {
      for (const Block& block : row) visit(block);
    }
  }
  // Where column c of a block begins to be part of the lower triangle.
  static int FirstRow(const Block& block, int c) { return block.row == block.column ? c : 0; }

  bool sparse_;
  std::vector<int> sizes_, starts_;
  std::vector<std::vector<Block>> blocks_;  // of each row
  std::vector<double> values_;
  Eigen::VectorXd b_;
  Eigen::MatrixXd dense_;
  Eigen::LLT<Eigen::MatrixXd> dense_cholesky_;
  Eigen::SparseMatrix<double> lower_;
  std::vector<int> lower_positions_;  // of each column of each block, in lower_'s values
  Eigen::SimplicialLLT<Eigen::SparseMatrix<double>> sparse_cholesky_;
};

}  // namespace airslam
