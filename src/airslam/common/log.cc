// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/common/log.h"

#include <spdlog/logger.h>
#include <spdlog/sinks/stdout_sinks.h>
#include <unistd.h>

#include <memory>

namespace airslam {
namespace {

spdlog::logger& Logger() {
  static const std::unique_ptr<spdlog::logger> logger = [] {
    auto made = std::make_unique<spdlog::logger>("airslam",
                                                 std::make_shared<spdlog::sinks::stderr_sink_mt>());
    // Carriage return and "erase line": a progress line is wiped, not written into.
    made->set_pattern(isatty(STDERR_FILENO) != 0 ? "\r\x1b[K%v" : "%v");
    made->flush_on(spdlog::level::trace);
    return made;
  }();
  return *logger;
}

spdlog::level::level_enum ToSpdlog(LogLevel level) {
  return level == LogLevel::kInfo ? spdlog::level::info : spdlog::level::warn;
}

}  // namespace

void LogLine(LogLevel level, const std::string& text) {
  const char* prefix = level == LogLevel::kWarning ? "airslam: warning: " : "airslam: ";
  Logger().log(ToSpdlog(level), prefix + text);
}

void SetLogLevel(LogLevel level) { Logger().set_level(ToSpdlog(level)); }

}  // namespace airslam
