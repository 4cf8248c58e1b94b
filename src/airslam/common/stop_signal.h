// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <atomic>
#include <string>

#include "airslam/common/error.h"

namespace airslam {

// While one exists, SIGTERM and SIGINT (Ctrl-C) raise a flag instead of ending the process, so that
// a long run can finish what it has. The second signal of a kind ends the process as usual. Only
// one at a time, made and destroyed on one thread; what stood before comes back at its end.
class StopSignal {
 public:
  StopSignal();
  ~StopSignal();
  StopSignal(const StopSignal&) = delete;
  StopSignal& operator=(const StopSignal&) = delete;

  // Raised by the first signal. Safe to read from any thread.
  const std::atomic<bool>& flag() const;
  // The signal that came, 0 before; and its name, "SIGTERM" or "SIGINT", "" before.
  int number() const;
  std::string name() const;

 private:
  struct Saved;
  Saved* saved_;
};

// A run that was asked to stop and did so in order. The command line prints the sentence and ends
// with 128 + the signal, as shells call it.
class Stopped : public Error {
 public:
  Stopped(int signal, const std::string& sentence) : Error(sentence), signal_(signal) {}
  int exit_code() const { return 128 + signal_; }

 private:
  int signal_;
};

}  // namespace airslam
