// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/place/vocabulary_training.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <deque>
#include <random>
#include <set>
#include <utility>
#include <vector>

#include "airslam/common/error.h"
#include "airslam/common/options.h"

namespace airslam {
namespace {

using Samples = std::vector<const float*>;  // descriptors, owned by the images
using Row = Eigen::Map<const Eigen::VectorXf>;

// Uniform in [0, 1), by hand so that every standard library draws the same.
double Uniform(std::mt19937_64& random) { return static_cast<double>(random() >> 11) * 0x1p-53; }

// Cosines of every centre with every sample.
class Clusters {
 public:
  Clusters(const Samples& samples, Eigen::Index size, int count, std::uint64_t seed)
      : samples_(samples), size_(size) {
    Seed(count, seed);
  }

  void Refine(int iterations) {
    for (int i = 0; i < iterations && Assign(); ++i) MoveCentres();
    Assign();
  }

  // The samples of each centre, without centres that have none.
  std::vector<std::pair<Eigen::VectorXf, Samples>> Take() const {
    std::vector<std::pair<Eigen::VectorXf, Samples>> clusters;
    for (Eigen::Index c = 0; c < centres_.rows(); ++c) {
      Samples members;
      for (std::size_t i = 0; i < samples_.size(); ++i) {
        if (assigned_[i] == c) members.push_back(samples_[i]);
      }
      if (!members.empty()) clusters.emplace_back(centres_.row(c).transpose(), std::move(members));
    }
    return clusters;
  }

 private:
  Row At(std::size_t i) const { return Row(samples_[i], size_); }

  // k-means++: each next centre is a sample, chosen with a probability that grows with its squared
  // distance, 2 - 2 cos, to the centres so far. Stops early when all samples are centres.
  void Seed(int count, std::uint64_t seed) {
    std::mt19937_64 random(seed);
    std::vector<double> distance(samples_.size(), 4.0);
    std::vector<std::size_t> chosen = {
        static_cast<std::size_t>(Uniform(random) * static_cast<double>(samples_.size()))};
    while (true) {
      double total = 0;
      for (std::size_t i = 0; i < samples_.size(); ++i) {
        const double squared = (At(i) - At(chosen.back())).squaredNorm();
        distance[i] = std::min(distance[i], squared);
        total += distance[i];
      }
      if (static_cast<int>(chosen.size()) == count || total <= 1e-9) break;
      double rest = Uniform(random) * total;
      std::size_t next = samples_.size();
      for (std::size_t i = 0; i < samples_.size() && rest >= 0; ++i) {
        if (distance[i] <= 0) continue;
        rest -= distance[i];
        next = i;
      }
      chosen.push_back(next);
    }
    centres_.resize(static_cast<Eigen::Index>(chosen.size()), size_);
    for (std::size_t c = 0; c < chosen.size(); ++c) {
      centres_.row(static_cast<Eigen::Index>(c)) = At(chosen[c]).transpose();
    }
    assigned_.assign(samples_.size(), -1);
  }

  // Gives every sample to its most similar centre; whether any changed.
  bool Assign() {
    bool changed = false;
    for (std::size_t i = 0; i < samples_.size(); ++i) {
      Eigen::Index best = 0;
      (centres_ * At(i)).maxCoeff(&best);
      changed = changed || assigned_[i] != best;
      assigned_[i] = best;
    }
    return changed;
  }

  void MoveCentres() {
    Eigen::MatrixXd sums = Eigen::MatrixXd::Zero(size_, centres_.rows());
    for (std::size_t i = 0; i < samples_.size(); ++i) {
      sums.col(assigned_[i]) += At(i).cast<double>();
    }
    for (Eigen::Index c = 0; c < centres_.rows(); ++c) {
      const double norm = sums.col(c).norm();
      if (norm > 0) centres_.row(c) = (sums.col(c) / norm).cast<float>().transpose();
    }
  }

  const Samples& samples_;
  Eigen::Index size_;
  DescriptorMatrix centres_;
  std::vector<Eigen::Index> assigned_;
};

Samples AllSamples(std::span<const DescriptorMatrix> images, Eigen::Index& size) {
  Samples samples;
  size = 0;
  for (const DescriptorMatrix& image : images) {
    if (image.rows() == 0) continue;
    if (size != 0 && image.cols() != size) {
      Fail("a vocabulary cannot be trained on descriptors of {} and of {} values", size,
           image.cols());
    }
    size = image.cols();
    if (!image.allFinite()) Fail("a vocabulary cannot be trained on values that are not finite");
    for (Eigen::Index i = 0; i < image.rows(); ++i) samples.push_back(image.data() + i * size);
  }
  return samples;
}

// ln(N / N_i), N the images with descriptors and N_i those with word i.
std::vector<float> InverseDocumentFrequencies(const Vocabulary& vocabulary,
                                              std::span<const DescriptorMatrix> images) {
  std::vector<int> images_with(static_cast<std::size_t>(vocabulary.words()), 0);
  int count = 0;
  for (const DescriptorMatrix& image : images) {
    if (image.rows() == 0) continue;
    ++count;
    const std::vector<WordId> words = vocabulary.Words(image);
    for (const WordId word : std::set<WordId>(words.begin(), words.end())) {
      ++images_with[static_cast<std::size_t>(word)];
    }
  }
  std::vector<float> weights;
  for (const int n : images_with) {
    // A word that only the rounding of the centres has emptied is as rare as one of one image.
    weights.push_back(static_cast<float>(std::log(static_cast<double>(count) / std::max(n, 1))));
  }
  return weights;
}

}  // namespace

void VocabularyOptions::Validate() const {
  RequireOption(branching >= 2 && branching <= 255, "branching", branching, "must be 2 to 255");
  RequireOption(levels >= 1 && levels <= 8, "levels", levels, "must be 1 to 8");
  RequireOption(iterations >= 1, "iterations", iterations, "must be at least 1");
}

Vocabulary TrainVocabulary(std::span<const DescriptorMatrix> images,
                           const std::string& network_sha256, const VocabularyOptions& options,
                           const std::function<void(std::int64_t)>& progress) {
  options.Validate();
  struct Open {
    Samples samples;
    int level;
  };
  Eigen::Index size = 0;
  std::deque<Open> open;
  open.push_back({AllSamples(images, size), 0});
  const auto total = static_cast<std::int64_t>(open.front().samples.size());
  std::vector<int> children;
  std::vector<Eigen::VectorXf> centres;
  std::int64_t done = 0;
  while (!open.empty()) {
    const Open node = std::move(open.front());
    open.pop_front();
    std::vector<std::pair<Eigen::VectorXf, Samples>> clusters;
    if (node.level < options.levels && node.samples.size() > 1) {
      Clusters split(node.samples, size, options.branching, options.seed + children.size());
      split.Refine(options.iterations);
      clusters = split.Take();
    }
    if (clusters.size() < 2) clusters.clear();  // all alike
    children.push_back(static_cast<int>(clusters.size()));
    if (clusters.empty()) done += static_cast<std::int64_t>(node.samples.size());
    for (auto& [centre, samples] : clusters) {
      centres.push_back(std::move(centre));
      open.push_back({std::move(samples), node.level + 1});
    }
    if (progress) progress(done);
  }
  if (centres.empty()) Fail("{} descriptors are too few, or too alike, for a vocabulary", total);
  DescriptorMatrix rows(static_cast<Eigen::Index>(centres.size()), size);
  for (std::size_t i = 0; i < centres.size(); ++i) {
    rows.row(static_cast<Eigen::Index>(i)) = centres[i].transpose();
  }
  Vocabulary vocabulary(children, QuantizeDescriptors(rows), network_sha256);
  vocabulary.SetWordWeights(InverseDocumentFrequencies(vocabulary, images));
  return vocabulary;
}

}  // namespace airslam
