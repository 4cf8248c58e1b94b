// SPDX-License-Identifier: BSD-3-Clause
//
// The fuzzers' corpora, and a few hundred seeded mutations of them, without a fuzzer: what every
// `make test` can afford. Inputs that once broke something stay in the corpora.
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

#include "airslam/common/error.h"
#include "entry_points.h"

namespace airslam {
namespace {

namespace fs = std::filesystem;
using Input = std::vector<std::uint8_t>;

std::vector<Input> Corpus(std::string_view target) {
  std::vector<fs::path> files;
  const fs::path folder = fs::path(AIRSLAM_SOURCE_DIR) / "fuzz" / "corpus" / target;
  for (const auto& entry : fs::directory_iterator(folder)) files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  std::vector<Input> inputs;
  for (const fs::path& file : files) {
    std::ifstream stream(file, std::ios::binary);
    inputs.emplace_back(std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>());
  }
  return inputs;
}

// Flips bits, overwrites, removes, repeats, and puts in what readers of numbers stumble over.
Input Mutate(Input input, std::mt19937& random) {
  static const std::vector<std::string> kWords = {"nan",
                                                  "inf",
                                                  "-1",
                                                  "0",
                                                  "1e999",
                                                  "99999999999999999999",
                                                  "-9223372036854775808",
                                                  "[",
                                                  "]",
                                                  "{",
                                                  "}",
                                                  ":",
                                                  ",",
                                                  "\n",
                                                  "\"",
                                                  "&a",
                                                  "*a",
                                                  "#"};
  const int changes = 1 + static_cast<int>(random() % 4);
  for (int i = 0; i < changes && !input.empty(); ++i) {
    const auto at = static_cast<std::ptrdiff_t>(random() % input.size());
    const auto length = static_cast<std::ptrdiff_t>(
        std::min<std::size_t>(1 + random() % 16, input.size() - static_cast<std::size_t>(at)));
    const auto place = input.begin() + at;
    switch (random() % 6) {
      case 0:
        *place = static_cast<std::uint8_t>(*place ^ (1u << random() % 8));
        break;
      case 1:
        *place = static_cast<std::uint8_t>(random());
        break;
      case 2:
        input.erase(place, place + length);
        break;
      case 3: {
        const Input part(place, place + length);
        input.insert(place, part.begin(), part.end());
        break;
      }
      case 4: {
        const std::string& word = kWords[random() % kWords.size()];
        input.insert(place, word.begin(), word.end());
        break;
      }
      default:
        input.resize(static_cast<std::size_t>(at) + 1);
    }
  }
  return input;
}

class Replay : public testing::TestWithParam<FuzzTarget> {
 protected:
  // The files of each run lie in memory where that can be had.
  static void SetUpTestSuite() {
    if (access("/dev/shm", W_OK) == 0) setenv("TMPDIR", "/dev/shm", 1);
  }
};

TEST_P(Replay, EveryInputIsReadOrRefused) {
  const std::vector<Input> corpus = Corpus(GetParam().name);
  ASSERT_FALSE(corpus.empty());
  for (const Input& input : corpus) EXPECT_NO_THROW(GetParam().run(input));
  std::mt19937 random(7);
  constexpr int kMutations = 1500;
  for (int i = 0; i < kMutations; ++i) {
    const Input input = Mutate(corpus[random() % corpus.size()], random);
    EXPECT_NO_THROW(GetParam().run(input))
        << "mutation " << i << ": " << std::string(input.begin(), input.end()).substr(0, 2000);
  }
}

INSTANTIATE_TEST_SUITE_P(Fuzz, Replay,
                         testing::ValuesIn(FuzzTargets().begin(), FuzzTargets().end()),
                         [](const auto& target) { return std::string(target.param.name); });

}  // namespace
}  // namespace airslam
