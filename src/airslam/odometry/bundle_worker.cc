// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/bundle_worker.h"

#include <utility>

#include "airslam/common/error.h"

namespace airslam {

BundleWorker::BundleWorker(const BundleOptions& options, StageTimes& times)
    : options_(options), times_(times), thread_([this] { Run(); }) {}

BundleWorker::~BundleWorker() {
  jobs_.Close();
  outcomes_.Close();
  thread_.join();
}

void BundleWorker::Submit(BundleJob job) { jobs_.Push(std::move(job)); }

BundleJob BundleWorker::Take() {
  std::optional<Outcome> outcome = outcomes_.Pop();
  if (!outcome) throw Error("the bundle adjustment was stopped before it had finished");
  if (outcome->error) std::rethrow_exception(outcome->error);
  return std::move(outcome->job);
}

void BundleWorker::Run() {
  while (std::optional<BundleJob> job = jobs_.Pop()) {
    Outcome outcome;
    try {
      ScopedStage stage(times_, "local bundle");
      job->summary = SolveBundle(options_, &job->problem);
      outcome.job = std::move(*job);
    } catch (...) {
      outcome.error = std::current_exception();
    }
    if (!outcomes_.Push(std::move(outcome))) return;
  }
}

}  // namespace airslam
