// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace airslam {

// Each adds one command with its options to the command line, each in a file of its own
// (<name>_command.cc). The command runs when it has been parsed; what it throws is its failure.
void AddMapCommand(CLI::App& app);
void AddInfoCommand(CLI::App& app);
void AddRefineCommand(CLI::App& app);
void AddMergeCommand(CLI::App& app);
void AddExportCommand(CLI::App& app);
void AddFeaturesCommand(CLI::App& app);
void AddDetectCommand(CLI::App& app);
void AddOptionsCommand(CLI::App& app);
void AddEvalCommand(CLI::App& app);
void AddCheckCalibCommand(CLI::App& app);
void AddDoctorCommand(CLI::App& app);
void AddTrainVocabularyCommand(CLI::App& app);
void AddLocalizeCommand(CLI::App& app);

}  // namespace airslam
