// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Cholesky>
#include <algorithm>
#include <span>
#include <vector>

#include "airslam/optimize/damping.h"
#include "airslam/optimize/reduced_system.h"

namespace airslam {

// The landmarks of one kind in a bundle adjustment: their parts of the normal equations, and how
// they are eliminated from them. Per landmark, with V its own block (kSize x kSize) and g its right
// side, W_i the block of an observing pose (6 x kSize), and V + D = L L' with the damping D:
//   Y_i = W_i L^-T,  z = L^-1 g,  H_ij -= Y_i Y_j',  b_i -= Y_i z,
// and when the poses' steps x_i are known, the landmark's is L^-T (z - sum Y_i' x_i). All sums run
// in the order of landmarks and, within one, of poses.
template <int kSize>
class LandmarkElimination {
 public:
  using Vector = Eigen::Matrix<double, kSize, 1>;
  using Matrix = Eigen::Matrix<double, kSize, kSize>;

  struct Seen {
    int landmark;
    int pose;
    int equation;  // of the pose, or -1 when it is held
  };
  using Coupling = Eigen::Matrix<double, 6, kSize>;
  struct Observation {
    int source;  // its number in the list given
    int pose, equation;
    bool used = true;  // an outlier is not
  };
  struct Landmark {
    int begin = 0, end_free = 0, end = 0;  // its observations: those by poses that move come first
    int first_pair = 0;                    // in the list of blocks
    Matrix information;                    // V, later L^-1
    Vector gradient;                       // g = -J' r
    Vector reduced;                        // z
    Vector damping, step;
  };

  LandmarkElimination(int landmarks, std::span<const Seen> seen);

  // Adds the blocks of poses that see a landmark together, where they are not there already.
  void AddStructure(ReducedSystem& system);

  std::vector<Landmark>& landmarks() { return landmarks_; }
  // Those of one landmark stand together.
  std::vector<Observation>& observations() { return observations_; }
  // W_i, later Y_i, of an observation by a pose that moves.
  Coupling& coupling(int observation) { return couplings_[observation]; }

  // Takes a landmark whose information, gradient and couplings are complete out of the equations.
  // False when its own block is not positive definite.
  bool Eliminate(Landmark& landmark, const Damping& damping, ReducedSystem& system);
  // The landmark's step, given that of the poses. Returns by how much it lowers the model's cost.
  double BackSubstitute(Landmark& landmark, const ReducedSystem& system, const Eigen::VectorXd& x);

 private:
  std::vector<Landmark> landmarks_;
  std::vector<Observation> observations_;
  std::vector<Coupling> couplings_;  // one an observation
  // Of each landmark, for each pair of poses a >= b that move: where their block begins.
  std::vector<int> pair_blocks_;
};

template <int kSize>
LandmarkElimination<kSize>::LandmarkElimination(int landmarks, std::span<const Seen> seen)
    : landmarks_(landmarks), observations_(seen.size()), couplings_(seen.size()) {
  std::vector<int> order(seen.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = static_cast<int>(i);
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
    if (seen[a].landmark != seen[b].landmark) return seen[a].landmark < seen[b].landmark;
    const bool a_held = seen[a].equation < 0, b_held = seen[b].equation < 0;
    if (a_held != b_held) return b_held;
    return seen[a].equation < seen[b].equation;
  });
  int pairs = 0;
  std::size_t next = 0;
  for (int l = 0; l < landmarks; ++l) {
    Landmark& landmark = landmarks_[l];
    landmark.begin = landmark.end_free = static_cast<int>(next);
    for (; next < order.size() && seen[order[next]].landmark == l; ++next) {
      const Seen& s = seen[order[next]];
      Observation& observation = observations_[next];
      observation.source = order[next];
      observation.pose = s.pose;
      observation.equation = s.equation;
      if (s.equation >= 0) ++landmark.end_free;
    }
    landmark.end = static_cast<int>(next);
    landmark.first_pair = pairs;
    const int free = landmark.end_free - landmark.begin;
    pairs += free * (free + 1) / 2;
  }
  pair_blocks_.resize(pairs);
}

template <int kSize>
void LandmarkElimination<kSize>::AddStructure(ReducedSystem& system) {
  // One row of blocks after the other, so that a table of one row finds what is there already.
  std::vector<std::vector<std::pair<int, int>>> seen_by;  // of each equation: landmark, place in it
  for (std::size_t l = 0; l < landmarks_.size(); ++l) {
    for (int i = landmarks_[l].begin; i < landmarks_[l].end_free; ++i) {
      const auto row = static_cast<std::size_t>(observations_[i].equation);
      if (seen_by.size() <= row) seen_by.resize(row + 1);
      seen_by[row].emplace_back(static_cast<int>(l), i - landmarks_[l].begin);
    }
  }
  std::vector<int> block_at(seen_by.size(), -1);  // of this row, by column
  for (int row = 0; row < static_cast<int>(seen_by.size()); ++row) {
    std::fill(block_at.begin(), block_at.end(), -1);
    for (const ReducedSystem::Block& block : system.row(row)) block_at[block.column] = block.begin;
    for (const auto& [l, a] : seen_by[row]) {
      const Landmark& landmark = landmarks_[l];
      for (int b = 0; b <= a; ++b) {
        const int column = observations_[landmark.begin + b].equation;
        if (block_at[column] < 0) block_at[column] = system.AddBlock(row, column);
        pair_blocks_[landmark.first_pair + a * (a + 1) / 2 + b] = block_at[column];
      }
    }
  }
}

template <int kSize>
bool LandmarkElimination<kSize>::Eliminate(Landmark& landmark, const Damping& damping,
                                           ReducedSystem& system) {
  landmark.damping = damping.Of(landmark.information.diagonal());
  landmark.information.diagonal() += landmark.damping;
  const Eigen::LLT<Matrix> cholesky(landmark.information);
  if (cholesky.info() != Eigen::Success) return false;
  landmark.information = cholesky.matrixL().solve(Matrix::Identity());
  landmark.reduced = landmark.information * landmark.gradient;
  const int free = landmark.end_free - landmark.begin;
  const Observation* const seen = observations_.data() + landmark.begin;
  Coupling* const couplings = couplings_.data() + landmark.begin;
  for (int a = 0; a < free; ++a) {
    if (!seen[a].used) continue;
    const Coupling y = couplings[a].lazyProduct(landmark.information.transpose());
    couplings[a] = y;
    system.gradient().template segment<6>(system.start(seen[a].equation)).noalias() -=
        y.lazyProduct(landmark.reduced);
    const int* block = pair_blocks_.data() + landmark.first_pair + a * (a + 1) / 2;
    for (int b = 0; b <= a; ++b) {
      if (!seen[b].used) continue;
      Eigen::Map<Eigen::Matrix<double, 6, 6>> target(system.values() + block[b]);
      target.noalias() -= y.lazyProduct(couplings[b].transpose());
      // A pose may see a landmark twice: of the block on the diagonal both triangles count.
      if (a != b && seen[a].equation == seen[b].equation) {
        target.noalias() -= couplings[b].lazyProduct(y.transpose());
      }
    }
  }
  return true;
}

template <int kSize>
double LandmarkElimination<kSize>::BackSubstitute(Landmark& landmark, const ReducedSystem& system,
                                                  const Eigen::VectorXd& x) {
  Vector right = landmark.reduced;
  for (int i = landmark.begin; i < landmark.end_free; ++i) {
    const Observation& o = observations_[i];
    if (!o.used) continue;
    right.noalias() -=
        couplings_[i].transpose().lazyProduct(x.template segment<6>(system.start(o.equation)));
  }
  landmark.step = landmark.information.transpose() * right;
  return Damping::Decrease(landmark.step, landmark.gradient, landmark.damping);
}

}  // namespace airslam
