// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <chrono>
#include <map>
#include <mutex>
#include <string>
#include <vector>

namespace airslam {

// Milliseconds that each named stage of a run took. Safe to record from several threads.
class StageTimes {
 public:
  struct Summary {
    int count = 0;
    double total_ms = 0;
    double mean_ms = 0;
    double median_ms = 0;
    double p95_ms = 0;
    double max_ms = 0;
  };

  void Record(const std::string& stage, double milliseconds);

  // One entry a stage, ordered by name.
  std::map<std::string, Summary> Summarize() const;

  // Milliseconds that each stage has taken in all so far. Quick: for asking after every frame.
  std::map<std::string, double> TotalsMs() const;

 private:
  mutable std::mutex mutex_;
  std::map<std::string, std::vector<float>> samples_;
  std::map<std::string, double> totals_ms_;
};

// Records the time from its construction to its destruction.
class ScopedStage {
 public:
  ScopedStage(StageTimes& times, std::string stage)
      : times_(times), stage_(std::move(stage)), start_(std::chrono::steady_clock::now()) {}
  ~ScopedStage() {
    const std::chrono::duration<double, std::milli> elapsed =
        std::chrono::steady_clock::now() - start_;
    times_.Record(stage_, elapsed.count());
  }
  ScopedStage(const ScopedStage&) = delete;
  ScopedStage& operator=(const ScopedStage&) = delete;

 private:
  StageTimes& times_;
  std::string stage_;
  std::chrono::steady_clock::time_point start_;
};

}  // namespace airslam
