// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/common/stop_signal.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

namespace airslam {
namespace {

TEST(StopSignal, RaisesAFlagInsteadOfEndingTheProcess) {
  for (const auto& [number, name] : {std::pair{SIGTERM, "SIGTERM"}, {SIGINT, "SIGINT"}}) {
    StopSignal stop;
    EXPECT_FALSE(stop.flag());
    EXPECT_EQ(stop.number(), 0);
    EXPECT_EQ(stop.name(), "");
    raise(number);
    EXPECT_TRUE(stop.flag());
    EXPECT_EQ(stop.number(), number);
    EXPECT_EQ(stop.name(), name);
  }
}

// The status of a child that runs `body`.
template <class Body>
int StatusOf(Body&& body) {
  const pid_t pid = fork();
  if (pid == 0) {
    body();
    _exit(7);
  }
  int status = 0;
  waitpid(pid, &status, 0);
  return status;
}

TEST(StopSignal, TheSecondSignalEndsTheProcess) {
  const int status = StatusOf([] {
    StopSignal stop;
    raise(SIGTERM);
    raise(SIGTERM);
  });
  EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGTERM);
}

TEST(StopSignal, GivesBackWhatStoodBefore) {
  const int status = StatusOf([] {
    { StopSignal stop; }
    raise(SIGINT);
  });
  EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGINT);
}

TEST(Stopped, HasTheExitCodeOfShells) {
  EXPECT_EQ(Stopped(SIGTERM, "stopped").exit_code(), 143);
  EXPECT_EQ(Stopped(SIGINT, "stopped").exit_code(), 130);
}

}  // namespace
}  // namespace airslam
