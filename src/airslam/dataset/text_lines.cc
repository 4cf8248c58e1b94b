// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/dataset/text_lines.h"

#include <cctype>
#include <charconv>
#include <cmath>
#include <fstream>
#include <string>

#include "airslam/common/error.h"

namespace airslam {
namespace {

constexpr std::int64_t kNsPerSecond = 1'000'000'000;
constexpr std::int64_t kMaxSeconds = 4'399'999'999;  // differences fit into 64 bits
constexpr std::string_view kSeparators = ", \t\r";

bool AllDigits(std::string_view text) {
  return text.find_first_not_of("0123456789") == std::string_view::npos;
}

void SplitWords(std::string_view line, Words* words) {
  words->clear();
  std::size_t begin = line.find_first_not_of(kSeparators);
  while (begin != std::string_view::npos) {
    const std::size_t end = line.find_first_of(kSeparators, begin);
    words->push_back(line.substr(begin, end - begin));
    begin = line.find_first_not_of(kSeparators, end);
  }
}

}  // namespace

void ForEachLine(const std::filesystem::path& file,
                 const std::function<void(int number, const Words& words)>& visit) {
  std::ifstream stream(file);
  if (!stream || !std::filesystem::is_regular_file(file)) {
    Fail("the file {} cannot be read", file.string());
  }
  std::string line;
  Words words;
  for (int number = 1; std::getline(stream, line); ++number) {
    SplitWords(line, &words);
    if (words.empty() || words[0].front() == '#') continue;
    if (number == 1 && std::isalpha(static_cast<unsigned char>(words[0].front()))) continue;
    visit(number, words);
  }
}

std::optional<double> ParseDouble(std::string_view word) {
  double value = 0;
  if (word.starts_with('+')) word.remove_prefix(1);
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error != std::errc() || end != word.data() + word.size()) return std::nullopt;
  if (!std::isfinite(value)) return std::nullopt;
  return value;
}

std::optional<std::int64_t> ParseInteger(std::string_view word) {
  std::int64_t value = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error != std::errc() || end != word.data() + word.size()) return std::nullopt;
  return value;
}

std::optional<std::int64_t> ParseTimeNs(std::string_view word) {
  constexpr std::int64_t kLimit = 4'400'000'000'000'000'000;
  const std::optional<std::int64_t> time = ParseInteger(word);
  return time && *time > -kLimit && *time < kLimit ? time : std::nullopt;
}

std::optional<std::int64_t> ParseSecondsToNs(std::string_view word) {
  const bool negative = word.starts_with('-');
  const std::string_view digits = negative ? word.substr(1) : word;
  const std::size_t dot = digits.find('.');
  const std::string_view whole = digits.substr(0, dot);
  const std::string_view fraction =
      dot == std::string_view::npos ? std::string_view() : digits.substr(dot + 1);
  // A plain decimal: its digits are taken as they are, as a double would lose some.
  if (!whole.empty() && whole.size() <= 10 && AllDigits(whole) && AllDigits(fraction)) {
    std::string nine(fraction.substr(0, 9));
    const bool round_up = fraction.size() > 9 && fraction[9] >= '5';
    nine.resize(9, '0');
    const std::int64_t seconds = *ParseInteger(whole);
    if (seconds > kMaxSeconds) return std::nullopt;
    const std::int64_t ns = seconds * kNsPerSecond + *ParseInteger(nine) + (round_up ? 1 : 0);
    return negative ? -ns : ns;
  }
  const std::optional<double> seconds = ParseDouble(word);
  if (!seconds || std::abs(*seconds) > kMaxSeconds) return std::nullopt;
  return std::llround(*seconds * 1e9);
}

}  // namespace airslam
