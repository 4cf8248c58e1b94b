// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <exception>
#include <thread>

#include "airslam/common/bounded_queue.h"
#include "airslam/common/stage_times.h"
#include "airslam/odometry/local_map.h"

namespace airslam {

// Solves local bundle adjustments on a thread of its own, one at a time. The owner decides when it
// takes a result, by frame number and never by the clock, so that every run repeats.
class BundleWorker {
 public:
  BundleWorker(const BundleOptions& options, StageTimes& times);
  ~BundleWorker();
  BundleWorker(const BundleWorker&) = delete;
  BundleWorker& operator=(const BundleWorker&) = delete;

  // At most one job may be under way.
  void Submit(BundleJob job);
  // Waits for the job that was submitted. Rethrows what solving it threw.
  BundleJob Take();

 private:
  struct Outcome {
    BundleJob job;
    std::exception_ptr error;
  };
  void Run();

  BundleOptions options_;
  StageTimes& times_;
  BoundedQueue<BundleJob> jobs_{1};
  BoundedQueue<Outcome> outcomes_{1};
  std::thread thread_;
};

}  // namespace airslam
