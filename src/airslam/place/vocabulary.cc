// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/place/vocabulary.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>
#include <system_error>
#include <utility>

#include "airslam/common/error.h"

namespace airslam {
namespace {

static_assert(std::endian::native == std::endian::little,
              "a big-endian machine must swap the bytes of vocabulary files");

constexpr char kMagic[8] = {'A', 'S', 'L', 'M', 'V', 'O', 'C', 'B'};
constexpr std::uint32_t kVersion = 1;
constexpr std::size_t kShaDigits = 64;
constexpr int kMaxChildren = 255;
// Larger ones are not vocabularies, and their sizes might not fit a size_t.
constexpr std::uint32_t kMaxNodes = 1U << 26, kMaxDescriptorSize = 1U << 14;
// ln(N / N_i) is far below; the weights of an image's words must have a sum.
constexpr float kMaxWeight = 1e6F;

// What stands before the arrays: children (uint8 a node), centres (int8), weights (float32).
struct Header {
  char magic[8];
  std::uint32_t version;
  std::uint32_t descriptor_size;
  std::uint32_t nodes;
  std::uint32_t words;
  double scale;  // of the centres: value = scale * int8, then to unit length
  char network_sha256[kShaDigits];
};
static_assert(sizeof(Header) == 96, "no padding: the header is written as it lies in memory");

void Append(Bytes& bytes, const void* data, std::size_t size) {
  const std::size_t end = bytes.size();
  bytes.resize(end + size);
  if (size > 0) std::memcpy(bytes.data() + end, data, size);
}

}  // namespace

double BagScore(const BagOfWords& a, const BagOfWords& b) {
  // For bags of norm 1, 1 - |a - b|_1 / 2 is the sum of the smaller weights.
  double score = 0;
  for (auto i = a.begin(), j = b.begin(); i != a.end() && j != b.end();) {
    if (i->word < j->word) {
      ++i;
    } else if (j->word < i->word) {
      ++j;
    } else {
      score += std::min(i++->weight, j++->weight);
    }
  }
  return score;
}

Vocabulary::Vocabulary(std::span<const int> children, QuantizedDescriptors centres,
                       std::string network_sha256)
    : stored_(std::move(centres)), network_sha256_(std::move(network_sha256)) {
  const auto nodes = static_cast<std::int64_t>(children.size());
  if (nodes < 2) Fail("a vocabulary of {} nodes has no words", nodes);
  std::int64_t next = 1;  // the first node that none has named as its child yet
  WordId words = 0;
  for (std::int64_t i = 0; i < nodes; ++i) {
    const int count = children[static_cast<std::size_t>(i)];
    if (count < 0 || count > kMaxChildren || i >= next || next + count > nodes) {
      Fail("the children of a vocabulary's {} nodes do not make a tree", nodes);
    }
    nodes_.push_back({static_cast<std::int32_t>(next), count});
    word_of_node_.push_back(count == 0 ? words++ : -1);
    next += count;
  }
  if (next != nodes) Fail("the children of a vocabulary's {} nodes do not make a tree", nodes);
  const DescriptorMatrix rows =
      RestoreDescriptors(stored_.values, stored_.scale, static_cast<int>(nodes - 1));
  if (rows.cols() < 1 || !rows.allFinite()) Fail("a vocabulary has centres without values");
  centres_.setZero(nodes, rows.cols());
  centres_.bottomRows(nodes - 1) = rows;
  weights_.assign(static_cast<std::size_t>(words), 1.0F);
}

void Vocabulary::SetWordWeights(std::vector<float> weights) {
  if (weights.size() != weights_.size()) {
    Fail("{} weights were given for {} words", weights.size(), weights_.size());
  }
  for (const float weight : weights) {
    if (!(weight >= 0 && weight <= kMaxWeight)) Fail("a word cannot weigh {}", weight);
  }
  weights_ = std::move(weights);
}

WordId Vocabulary::Lookup(const float* descriptor) const {
  using Row = Eigen::Map<const Eigen::VectorXf>;
  const Eigen::Index size = centres_.cols();
  const Row query(descriptor, size);
  std::size_t node = 0;
  while (nodes_[node].children > 0) {
    const std::int32_t first = nodes_[node].first_child;
    std::int32_t best = first;
    float best_cosine = -2;
    for (std::int32_t child = first; child < first + nodes_[node].children; ++child) {
      const float cosine = Row(centres_.data() + child * size, size).dot(query);
      if (cosine > best_cosine) {
        best_cosine = cosine;
        best = child;
      }
    }
    node = static_cast<std::size_t>(best);
  }
  return word_of_node_[node];
}

std::vector<WordId> Vocabulary::Words(const DescriptorMatrix& descriptors) const {
  std::vector<WordId> words;
  if (descriptors.rows() == 0) return words;
  if (empty()) Fail("an empty vocabulary has no words for descriptors");
  if (descriptors.cols() != centres_.cols()) {
    Fail("the vocabulary has words for descriptors of {} values, not of {}", centres_.cols(),
         descriptors.cols());
  }
  words.reserve(static_cast<std::size_t>(descriptors.rows()));
  for (Eigen::Index i = 0; i < descriptors.rows(); ++i) {
    words.push_back(Lookup(descriptors.data() + i * descriptors.cols()));
  }
  return words;
}

BagOfWords Vocabulary::Bag(std::span<const WordId> words) const {
  std::vector<WordId> sorted(words.begin(), words.end());
  std::sort(sorted.begin(), sorted.end());
  BagOfWords bag;
  float norm = 0;
  for (const WordId word : sorted) {
    if (word < 0 || word >= this->words()) {
      Fail("word {} is not one of the vocabulary's {}", word, this->words());
    }
    const float weight = weights_[static_cast<std::size_t>(word)];
    if (weight <= 0) continue;
    norm += weight;
    if (!bag.empty() && bag.back().word == word) {
      bag.back().weight += weight;
    } else {
      bag.push_back({word, weight});
    }
  }
  for (WordWeight& entry : bag) entry.weight /= norm;
  return bag;
}

void Vocabulary::RequireNetwork(const std::string& sha256, const std::string& whose) const {
  if (sha256 == network_sha256_) return;
  Fail(
      "the vocabulary was trained on descriptors of the feature network {:.12}, not on those of "
      "{}, {:.12}: train one with airslam train-vocabulary",
      network_sha256_, whose, sha256);
}

std::vector<std::byte> Vocabulary::Encode() const {
  if (empty()) Fail("an empty vocabulary cannot be stored");
  Header header = {};
  std::copy(std::begin(kMagic), std::end(kMagic), header.magic);
  header.version = kVersion;
  header.descriptor_size = static_cast<std::uint32_t>(centres_.cols());
  header.nodes = static_cast<std::uint32_t>(nodes_.size());
  header.words = static_cast<std::uint32_t>(words());
  header.scale = stored_.scale;
  std::copy_n(network_sha256_.begin(), std::min(network_sha256_.size(), kShaDigits),
              header.network_sha256);
  Bytes bytes;
  Append(bytes, &header, sizeof(header));
  for (const Node& node : nodes_) {
    const auto children = static_cast<std::uint8_t>(node.children);
    Append(bytes, &children, 1);
  }
  Append(bytes, stored_.values.data(), stored_.values.size());
  Append(bytes, weights_.data(), weights_.size() * sizeof(float));
  return bytes;
}

Vocabulary Vocabulary::Decode(std::span<const std::byte> bytes, const std::string& where) {
  Header header;
  if (bytes.size() < sizeof(header))
    Fail("{}: not a vocabulary: it has {} bytes", where, bytes.size());
  std::memcpy(&header, bytes.data(), sizeof(header));
  if (!std::equal(std::begin(kMagic), std::end(kMagic), header.magic)) {
    Fail("{}: not a vocabulary", where);
  }
  if (header.version != kVersion) {
    Fail("{}: a vocabulary of version {}, this program reads version {}", where, header.version,
         kVersion);
  }
  const std::size_t nodes = header.nodes, size = header.descriptor_size, words = header.words;
  const std::size_t centres = nodes > 0 ? (nodes - 1) * size : 0;
  if (header.nodes > kMaxNodes || header.descriptor_size > kMaxDescriptorSize ||
      bytes.size() != sizeof(header) + nodes + centres + words * sizeof(float)) {
    Fail("{}: the vocabulary is truncated or damaged: it has {} bytes", where, bytes.size());
  }
  bytes = bytes.subspan(sizeof(header));
  std::vector<int> children;
  for (const std::byte count : bytes.first(nodes)) children.push_back(static_cast<int>(count));
  bytes = bytes.subspan(nodes);
  std::vector<float> weights(words);
  std::ranges::copy(bytes.subspan(centres), std::as_writable_bytes(std::span(weights)).begin());
  const char* sha = header.network_sha256;
  const char* end = std::find(sha, sha + kShaDigits, '\0');
  const std::string network(sha, end);
  try {
    if (std::any_of(end, sha + kShaDigits, [](char c) { return c != '\0'; })) {
      Fail("something follows the digest of its network");
    }
    Vocabulary vocabulary(
        children,
        {Bytes(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(centres)), header.scale},
        network);
    vocabulary.SetWordWeights(std::move(weights));
    return vocabulary;
  } catch (const Error& error) {
    Fail("{}: the vocabulary is damaged: {}", where, error.what());
  }
}

void Vocabulary::Write(const std::filesystem::path& file) const {
  const std::vector<std::byte> bytes = Encode();
  const std::filesystem::path partial = file.string() + ".partial";
  std::ofstream stream(partial, std::ios::binary);
  stream.write(reinterpret_cast<const char*>(bytes.data()),
               static_cast<std::streamsize>(bytes.size()));
  stream.close();
  std::error_code error;
  if (stream) std::filesystem::rename(partial, file, error);
  if (!stream || error) Fail("{}: the vocabulary could not be written", file.string());
}

Vocabulary Vocabulary::Read(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  if (!stream) Fail("{}: the vocabulary cannot be read", file.string());
  const std::string text((std::istreambuf_iterator<char>(stream)),
                         std::istreambuf_iterator<char>());
  return Decode(std::as_bytes(std::span(text)), file.string());
}

}  // namespace airslam
