// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/common/progress.h"

#include <fmt/format.h>
#include <unistd.h>

#include <chrono>
#include <utility>

namespace airslam {
namespace {

constexpr double kTerminalInterval_s = 0.1;
constexpr double kLogInterval_s = 5.0;

}  // namespace

std::string FormatProgress(std::string_view label, int done, int total, double elapsed_s,
                           std::string_view state) {
  std::string line = fmt::format("{} {}", label, done);
  if (total > 0) line += fmt::format("/{} {}%", total, 100LL * done / total);
  if (elapsed_s > 0) line += fmt::format(" {:.1f}/s", done / elapsed_s);
  if (!state.empty()) line += fmt::format(" {}", state);
  return line;
}

Progress::Output Progress::StandardError() {
  return {stderr, isatty(STDERR_FILENO) != 0, [] {
            const auto now = std::chrono::steady_clock::now().time_since_epoch();
            return std::chrono::duration<double>(now).count();
          }};
}

Progress::Progress(std::string label, int total, Output output)
    : label_(std::move(label)),
      total_(total),
      output_(std::move(output)),
      start_s_(output_.now_s()),
      written_s_(start_s_) {}

void Progress::Update(int done, std::string_view state) {
  const double interval_s = output_.terminal ? kTerminalInterval_s : kLogInterval_s;
  if (output_.now_s() - written_s_ >= interval_s) Write(done, state, /*last=*/false);
}

void Progress::Finish(int done, std::string_view state) { Write(done, state, /*last=*/true); }

void Progress::Write(int done, std::string_view state, bool last) {
  written_s_ = output_.now_s();
  const std::string line = FormatProgress(label_, done, total_, written_s_ - start_s_, state);
  // On a terminal: carriage return, then erase what stood in the line.
  const char* begin = output_.terminal ? "\r\x1b[K" : "";
  const char* end = output_.terminal && !last ? "" : "\n";
  fmt::print(output_.stream, "{}{}{}", begin, line, end);
  std::fflush(output_.stream);
}

}  // namespace airslam
