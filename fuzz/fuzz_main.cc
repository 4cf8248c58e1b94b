// SPDX-License-Identifier: BSD-3-Clause
//
// One libFuzzer program a target; AIRSLAM_FUZZ_TARGET names it.
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>

#include "entry_points.h"

// The files of each run lie in memory where that can be had.
extern "C" int LLVMFuzzerInitialize(int*, char***) {
  if (access("/dev/shm", W_OK) == 0) setenv("TMPDIR", "/dev/shm", 1);
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const airslam::FuzzTarget* target = airslam::FindFuzzTarget(AIRSLAM_FUZZ_TARGET);
  target->run({data, size});  // what it lets escape ends the fuzzer as a crash
  return 0;
}
