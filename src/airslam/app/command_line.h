// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace airslam {

// Parses and runs one `airslam` command. Errors become one sentence on the standard error stream.
// Returns the process's exit code: 0 on success, 1 when the command failed, 2 on wrong usage.
int RunCommandLine(int argc, char** argv);

}  // namespace airslam
