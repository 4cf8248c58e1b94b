// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/optimize/reduced_system.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <vector>

namespace airslam {
namespace {

const std::vector<int> kSizes = {6, 6, 3, 6, 2, 6};

// A system with random blocks in a band and one far from it, and the same as one matrix.
struct RandomSystem {
  explicit RandomSystem(bool sparse) : system(kSizes, sparse) {
    std::vector<int> begins;
    for (const auto& [row, column] : kPairs) begins.push_back(system.AddBlock(row, column));
    system.FinishStructure();
    system.SetZero();
    whole = Eigen::MatrixXd::Zero(system.rows(), system.rows());
    std::srand(3);
    for (int i = 0; i < static_cast<int>(kSizes.size()); ++i) Fill(i, i, system.diagonal(i));
    for (std::size_t k = 0; k < begins.size(); ++k) {
      Fill(kPairs[k].first, kPairs[k].second, begins[k]);
    }
    system.gradient().setRandom();
  }

  void Fill(int row, int column, int begin) {
    const int height = system.size(row), width = system.size(column);
    Eigen::MatrixXd block = Eigen::MatrixXd::Random(height, width);
    if (row == column)
      block = block * block.transpose() + 20 * Eigen::MatrixXd::Identity(height, height);
    Eigen::Map<Eigen::MatrixXd>(system.values() + begin, height, width) = block;
    whole.block(system.start(row), system.start(column), height, width) = block;
    whole.block(system.start(column), system.start(row), width, height) = block.transpose();
  }

  inline static const std::vector<std::pair<int, int>> kPairs = {{1, 0}, {2, 1}, {3, 1}, {3, 2},
                                                                 {4, 3}, {5, 4}, {5, 0}};
  ReducedSystem system;
  Eigen::MatrixXd whole;
};

TEST(ReducedSystem, SolvesDenseAndSparse) {
  for (const bool sparse : {false, true}) {
    RandomSystem random(sparse);
    ASSERT_EQ(random.system.rows(), 29);
    const Eigen::VectorXd damping = Eigen::VectorXd::LinSpaced(29, 0.5, 3);
    Eigen::VectorXd x;
    for (int again = 0; again < 2; ++again) {  // solving must not change the system
      ASSERT_TRUE(random.system.Solve(damping, &x));
      const Eigen::VectorXd left = (random.whole + Eigen::MatrixXd(damping.asDiagonal())) * x;
      EXPECT_LT((left - random.system.gradient()).norm(), 1e-12) << sparse;
    }
  }
}

TEST(ReducedSystem, RefusesWhatIsNotPositiveDefinite) {
  for (const bool sparse : {false, true}) {
    RandomSystem random(sparse);
    Eigen::VectorXd x;
    EXPECT_FALSE(random.system.Solve(Eigen::VectorXd::Constant(29, -100), &x)) << sparse;
  }
}

TEST(ReducedSystem, MayBeEmpty) {
  for (const bool sparse : {false, true}) {
    ReducedSystem system({}, sparse);
    system.FinishStructure();
    system.SetZero();
    Eigen::VectorXd x(3);
    EXPECT_TRUE(system.Solve(Eigen::VectorXd(0), &x));
    EXPECT_EQ(x.size(), 0);
  }
}

}  // namespace
}  // namespace airslam
