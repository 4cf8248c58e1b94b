// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/format.h>

#include <stdexcept>
#include <string>
#include <utility>

namespace airslam {

// A text on one line. What a damaged file holds, or SQLite says, may stand in a sentence about it:
// line breaks and other control characters become blanks.
inline std::string OneLine(std::string text) {
  for (char& c : text) {
    if (static_cast<unsigned char>(c) < ' ') c = ' ';
  }
  return text;
}

// What went wrong with the user's input or environment, as one clear sentence that names the file,
// line or field and what was expected. The command line prints it and ends with a non-zero code;
// Python raises it as airslam.Error.
class Error : public std::runtime_error {
 public:
  explicit Error(const std::string& sentence) : std::runtime_error(OneLine(sentence)) {}
};

// Throws an Error whose text is formatted as by fmt::format.
template <typename... Args>
[[noreturn]] void Fail(fmt::format_string<Args...> format, Args&&... args) {
  throw Error(fmt::format(format, std::forward<Args>(args)...));
}

}  // namespace airslam
