// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/common/atomic_file.h"

#include <fcntl.h>
#include <unistd.h>

#include "airslam/common/error.h"

namespace airslam {
namespace fs = std::filesystem;

AtomicFile::AtomicFile(const fs::path& file) : file_(file), partial_(file.string() + ".partial") {
  std::error_code error;
  if (fs::is_directory(file, error)) Fail("{} is a folder, not a file to write", file.string());
  if (file.has_parent_path()) {
    fs::create_directories(file.parent_path(), error);
    if (error) Fail("{} cannot be written: {}", file.string(), error.message());
  }
  fs::remove(partial_, error);
  if (error) Fail("{} cannot be written: {}", partial_.string(), error.message());
}

AtomicFile::~AtomicFile() {
  std::error_code ignored;
  fs::remove(partial_, ignored);
}

void AtomicFile::Commit() {
  // The content must be on the disk before the name is: a power failure must not leave half a file.
  if (const int descriptor = open(partial_.c_str(), O_RDONLY); descriptor >= 0) {
    fsync(descriptor);
    close(descriptor);
  }
  std::error_code error;
  fs::rename(partial_, file_, error);
  if (error) Fail("{} cannot be written: {}", file_.string(), error.message());
}

}  // namespace airslam
