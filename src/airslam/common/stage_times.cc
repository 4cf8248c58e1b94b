// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/common/stage_times.h"

#include <algorithm>
#include <numeric>

namespace airslam {

void StageTimes::Record(const std::string& stage, double milliseconds) {
  std::lock_guard lock(mutex_);
  samples_[stage].push_back(static_cast<float>(milliseconds));
  totals_ms_[stage] += milliseconds;
}

std::map<std::string, double> StageTimes::TotalsMs() const {
  std::lock_guard lock(mutex_);
  return totals_ms_;
}

std::map<std::string, StageTimes::Summary> StageTimes::Summarize() const {
  std::lock_guard lock(mutex_);
  std::map<std::string, Summary> result;
  for (const auto& [stage, samples] : samples_) {
    std::vector<float> sorted = samples;
    std::sort(sorted.begin(), sorted.end());
    Summary& s = result[stage];
    s.count = static_cast<int>(sorted.size());
    s.total_ms = std::accumulate(sorted.begin(), sorted.end(), 0.0);
    s.mean_ms = s.total_ms / s.count;
    s.median_ms = sorted[sorted.size() / 2];
    s.p95_ms = sorted[sorted.size() * 95 / 100];
    s.max_ms = sorted.back();
  }
  return result;
}

}  // namespace airslam
