// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/common/options.h"

#include <cstdio>
#include <memory>
#include <string>

#include "airslam/app/commands.h"
#include "airslam/odometry/options.h"
#include "airslam/refine/options.h"
#include "airslam/relocalize/localizer.h"

namespace airslam {
namespace {

template <class Options>
std::string Describe(bool markdown) {
  Options options;
  const std::vector<OptionBinding> bindings = CollectOptions(options);
  return markdown ? TabulateOptions(bindings) : DescribeOptions(bindings);
}

}  // namespace

void AddOptionsCommand(CLI::App& app) {
  struct Arguments {
    std::string command;
    bool markdown = false;
  };
  const auto arguments = std::make_shared<Arguments>();
  CLI::App* command = app.add_subcommand(
      "options", "Print every option of a command with its default, range and meaning");
  command->add_option("command", arguments->command, "Whose --config it is")
      ->check(CLI::IsMember({"map", "refine", "localize"}))
      ->required();
  command->add_flag("--markdown", arguments->markdown,
                    "Tables, instead of a YAML file to start from");
  command->callback([arguments] {
    const bool markdown = arguments->markdown;
    const std::string text = arguments->command == "map" ? Describe<OdometryOptions>(markdown)
                             : arguments->command == "refine"
                                 ? Describe<RefineOptions>(markdown)
                                 : Describe<LocalizationOptions>(markdown);
    std::fputs(text.c_str(), stdout);
  });
}

}  // namespace airslam
