// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/app/command_line.h"

int main(int argc, char** argv) { return airslam::RunCommandLine(argc, argv); }
