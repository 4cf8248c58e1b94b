// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/app/command_line.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>
#include <opencv2/core/utility.hpp>
#include <string>
#include <vector>

#include "airslam/app/commands.h"
#include "airslam/common/error.h"
#include "airslam/common/stop_signal.h"
#include "airslam/common/version.h"

namespace airslam {
namespace {

// One sentence, and where to read on.
std::string DescribeWrongUsage(const CLI::App* app, const CLI::Error& error) {
  const std::vector<CLI::App*> commands = app->get_subcommands();
  const std::vector<std::string> unknown = app->remaining();
  std::string sentence = error.what();
  if (commands.empty() && !unknown.empty()) sentence = unknown.front() + " is not a command";
  const std::string command = commands.empty() ? "" : commands.front()->get_name() + ' ';
  return "airslam: " + sentence + "; see airslam " + command + "--help\n";
}

}  // namespace

int RunCommandLine(int argc, char** argv) {
  // The stages have threads of their own; OpenCV's would only contend with them.
  cv::setNumThreads(1);
  CLI::App app("AirSLAM: point-line visual SLAM for robots in changing light", "airslam");
  app.require_subcommand(1);
  app.failure_message(DescribeWrongUsage);
  app.set_version_flag("--version", std::string("airslam ") + kVersion);
  AddMapCommand(app);
  AddInfoCommand(app);
  AddRefineCommand(app);
  AddMergeCommand(app);
  AddExportCommand(app);
  AddFeaturesCommand(app);
  AddDetectCommand(app);
  AddOptionsCommand(app);
  AddEvalCommand(app);
  AddCheckCalibCommand(app);
  AddDoctorCommand(app);
  AddTrainVocabularyCommand(app);
  AddLocalizeCommand(app);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  } catch (const Stopped& stopped) {
    std::fprintf(stderr, "airslam: %s\n", stopped.what());
    return stopped.exit_code();
  } catch (const std::exception& error) {  // Error, or of a library
    std::fprintf(stderr, "airslam: %s\n", OneLine(error.what()).c_str());
    return 1;
  }
  if (std::fflush(stdout) != 0 || std::ferror(stdout) != 0) {
    std::fprintf(stderr, "airslam: the standard output cannot be written\n");
    return 1;
  }
  return 0;
}

}  // namespace airslam
