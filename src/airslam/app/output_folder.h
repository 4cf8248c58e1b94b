// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>

namespace airslam {

// Makes a folder of results, to which files are added. Throws Error that names it.
void PrepareFolder(const std::filesystem::path& out);

// Writes a text file of it: beside its place and then put there, so that no half of it is ever
// seen. Throws Error that names the file.
void WriteText(const std::filesystem::path& file, const std::string& text);

}  // namespace airslam
