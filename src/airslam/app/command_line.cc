// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/app/command_line.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>

#include "airslam/app/commands.h"

namespace airslam {

int RunCommandLine(int argc, char** argv) {
  CLI::App app("AirSLAM: point-line visual SLAM for robots in changing light", "airslam");
  app.require_subcommand(1);
  app.set_version_flag("--version", "airslam 0.1.0");
  AddMapCommand(app);
  AddInfoCommand(app);
  AddFeaturesCommand(app);
  AddEvalCommand(app);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "airslam: %s\n", error.what());
    return 1;
  }
  return 0;
}

}  // namespace airslam
