// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/iteration_callback.h>

#include <functional>
#include <utility>

namespace airslam {

// Tells `report` the number of each iteration of a solver, from `first` on.
class IterationReporter : public ceres::IterationCallback {
 public:
  IterationReporter(std::function<void(int)> report, int first)
      : report_(std::move(report)), first_(first) {}

  ceres::CallbackReturnType operator()(const ceres::IterationSummary& summary) override {
    if (report_) report_(first_ + summary.iteration);
    return ceres::SOLVER_CONTINUE;
  }

 private:
  std::function<void(int)> report_;
  int first_;
};

}  // namespace airslam
