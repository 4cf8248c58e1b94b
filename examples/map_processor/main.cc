// SPDX-License-Identifier: BSD-3-Clause
//
// The airslam command line with one more map processor. Name it in the configuration:
//
//   processors: loop_closure, merge, pose_graph, global_bundle, remove_low_quality
#include "airslam/app/command_line.h"
#include "remove_low_quality.h"

int main(int argc, char** argv) {
  airslam::RegisterMapProcessor("remove_low_quality",
                                [] { return std::make_unique<RemoveLowQuality>(); });
  return airslam::RunCommandLine(argc, argv);
}
