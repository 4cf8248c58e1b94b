// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/live_odometry.h"

#include <utility>

#include "airslam/common/error.h"

namespace airslam {

LiveOdometry::LiveOdometry(const StereoRig& rig, const MapRunRequest& request,
                           FrameObserver observer)
    : run_(rig, request),
      sequence_(rig, request.options.inertial.enabled),
      thread_([this, observer = std::move(observer)] { Work(observer); }) {}

LiveOdometry::~LiveOdometry() {
  sequence_.Abandon();
  if (thread_.joinable()) thread_.join();
}

void LiveOdometry::Work(const FrameObserver& observer) {
  try {
    result_ = RunPipeline(sequence_, run_.rectifier(), run_.options(), run_.networks(),
                          run_.recorder(), observer, run_.times());
  } catch (...) {
    error_ = std::current_exception();
  }
  sequence_.Abandon();
}

void LiveOdometry::RethrowInstead() {
  if (sequence_.abandoned() && thread_.joinable()) {
    thread_.join();
    if (error_) std::rethrow_exception(error_);
  }
  throw;
}

void LiveOdometry::AddImu(const ImuSample& sample) {
  try {
    sequence_.AddImu(sample);
  } catch (const Error&) {
    RethrowInstead();
  }
}

void LiveOdometry::AddFrame(const StereoPair& pair) {
  try {
    sequence_.AddFrame(pair);
  } catch (const Error&) {
    RethrowInstead();
  }
}

LiveOdometry::Outcome LiveOdometry::Finish() {
  sequence_.End();
  if (thread_.joinable()) thread_.join();
  if (error_) std::rethrow_exception(error_);
  if (!result_) Fail("the run has been finished already");
  Outcome outcome{*std::exchange(result_, std::nullopt), {}};
  outcome.info = run_.Commit(outcome.result, sequence_.size());
  return outcome;
}

}  // namespace airslam
