// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/app/output_folder.h"

#include <fstream>
#include <system_error>

#include "airslam/common/error.h"

namespace airslam {
namespace fs = std::filesystem;

void PrepareFolder(const fs::path& out) {
  std::error_code error;
  fs::create_directories(out, error);
  if (!fs::is_directory(out)) {
    Fail("{}: the folder of results cannot be created{}", out.string(),
         error ? ": " + error.message() : std::string());
  }
}

void WriteText(const fs::path& file, const std::string& text) {
  const fs::path partial = file.string() + ".partial";
  std::ofstream stream(partial, std::ios::binary);
  stream << text;
  stream.close();
  std::error_code error;
  if (stream) fs::rename(partial, file, error);
  if (!stream || error) Fail("{}: the file could not be written", file.string());
}

}  // namespace airslam
