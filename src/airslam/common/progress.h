// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdio>
#include <functional>
#include <string>
#include <string_view>

namespace airslam {

// "map 120/1000 12% 31.4/s tracking": what a progress line says. `total` 0: not known.
std::string FormatProgress(std::string_view label, int done, int total, double elapsed_s,
                           std::string_view state);

// A progress line on the standard error stream: rewritten in place on a terminal, ten times a
// second at the most; elsewhere (a log file) a line of its own about every five seconds. The rate
// is the mean since construction. Not thread-safe: one thread reports.
class Progress {
 public:
  // Where and how to write; the defaults are for use, other values for tests.
  struct Output {
    std::FILE* stream = stderr;
    bool terminal = false;
    std::function<double()> now_s;  // a clock in seconds that does not go back
  };
  static Output StandardError();

  // `total` items are expected; 0 when that is not known.
  Progress(std::string label, int total, Output output = StandardError());

  // `done` items so far; `state` is a word or two on how things are, such as "tracking".
  void Update(int done, std::string_view state);

  // Writes the last line, whatever the time, and ends it.
  void Finish(int done, std::string_view state);

 private:
  void Write(int done, std::string_view state, bool last);

  std::string label_;
  int total_;
  Output output_;
  double start_s_;
  double written_s_;
};

}  // namespace airslam
