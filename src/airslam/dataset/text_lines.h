// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string_view>
#include <vector>

namespace airslam {

using Words = std::vector<std::string_view>;

// Calls `visit` with the number (from 1) and the words of each line of a text file. Commas, blanks
// and tabs separate words. Empty lines, lines that begin with # and a first line that begins with a
// letter (a header) are skipped. Throws Error when the file cannot be read.
void ForEachLine(const std::filesystem::path& file,
                 const std::function<void(int number, const Words& words)>& visit);

// The whole word as a finite number, or nothing.
std::optional<double> ParseDouble(std::string_view word);
std::optional<std::int64_t> ParseInteger(std::string_view word);

// A time in whole nanoseconds; nothing when it lies 140 years or more from 0, so that differences
// of two times always fit.
std::optional<std::int64_t> ParseTimeNs(std::string_view word);

// Seconds as decimal text to nanoseconds, exact for plain decimals ("1403715273.262142976") and
// rounded for exponents ("1.037359e-01"). Nothing when it is not a number or does not fit.
std::optional<std::int64_t> ParseSecondsToNs(std::string_view word);

}  // namespace airslam
