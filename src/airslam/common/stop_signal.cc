// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/common/stop_signal.h"

#include <signal.h>

namespace airslam {
namespace {

// What the handler may touch: lock-free, so that it is safe within a signal.
std::atomic<bool> raised = false;
std::atomic<int> raised_by = 0;
static_assert(std::atomic<bool>::is_always_lock_free && std::atomic<int>::is_always_lock_free);

extern "C" void RaiseStop(int number) {
  raised_by = number;
  raised = true;
}

}  // namespace

struct StopSignal::Saved {
  struct sigaction terminate, interrupt;
};

StopSignal::StopSignal() : saved_(new Saved) {
  raised = false;
  raised_by = 0;
  struct sigaction action = {};
  action.sa_handler = RaiseStop;
  action.sa_flags = static_cast<int>(SA_RESETHAND | SA_RESTART);
  sigemptyset(&action.sa_mask);
  sigaction(SIGTERM, &action, &saved_->terminate);
  sigaction(SIGINT, &action, &saved_->interrupt);
}

StopSignal::~StopSignal() {
  sigaction(SIGTERM, &saved_->terminate, nullptr);
  sigaction(SIGINT, &saved_->interrupt, nullptr);
  delete saved_;
}

const std::atomic<bool>& StopSignal::flag() const { return raised; }

int StopSignal::number() const { return raised_by; }

std::string StopSignal::name() const {
  switch (number()) {
    case 0:
      return "";
    case SIGINT:
      return "SIGINT";
    default:
      return "SIGTERM";
  }
}

}  // namespace airslam
