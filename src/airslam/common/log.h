// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/format.h>

#include <string>
#include <utility>

namespace airslam {

enum class LogLevel { kInfo, kWarning };

// Writes one line to the standard error stream, "airslam: ..." or "airslam: warning: ...". On a
// terminal it first wipes a progress line that may stand there. Safe from several threads.
void LogLine(LogLevel level, const std::string& text);

// Nothing below `level` is written from now on. The default is kInfo.
void SetLogLevel(LogLevel level);

// What a user wants to know about a run that goes well. Formatted as by fmt::format.
template <typename... Args>
void LogInfo(fmt::format_string<Args...> format, Args&&... args) {
  LogLine(LogLevel::kInfo, fmt::format(format, std::forward<Args>(args)...));
}

// What went wrong but did not stop the run.
template <typename... Args>
void LogWarn(fmt::format_string<Args...> format, Args&&... args) {
  LogLine(LogLevel::kWarning, fmt::format(format, std::forward<Args>(args)...));
}

}  // namespace airslam
