// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/common/atomic_directory.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <string>

#include "airslam/common/error.h"

namespace airslam {
namespace fs = std::filesystem;
namespace {

// Marks a partial folder as this program's until it is complete.
constexpr char kMarker[] = ".airslam-partial";

bool IsResult(const fs::path& folder) {
  return fs::is_empty(folder) || fs::exists(folder / "report.json") ||
         fs::exists(folder / "map.db") || fs::exists(folder / kMarker);
}

// Throws unless `folder` is absent or may be replaced.
void RequireReplaceable(const fs::path& folder) {
  if (!fs::exists(fs::symlink_status(folder))) return;
  if (!fs::is_directory(folder)) Fail("{} is there and is not a folder", folder.string());
  if (!IsResult(folder)) {
    Fail(
        "{} holds other files (neither report.json nor map.db is among them) and will not be "
        "replaced; name another folder",
        folder.string());
  }
}

// Locks the folder for this process, until the descriptor returned is closed.
int LockFolder(const fs::path& folder) {
  const int descriptor = open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor < 0) Fail("cannot open {}: {}", folder.string(), std::strerror(errno));
  if (flock(descriptor, LOCK_EX | LOCK_NB) != 0) {
    close(descriptor);
    Fail("another run is writing {}", folder.string());
  }
  return descriptor;
}

// The folder's absolute path without a trailing slash; links are followed, so that the folder
// itself is replaced.
fs::path Resolve(const fs::path& out) {
  fs::path resolved = fs::weakly_canonical(fs::absolute(out));
  if (!resolved.has_filename()) resolved = resolved.parent_path();
  if (!resolved.has_filename()) Fail("{} cannot be an output folder", out.string());
  return resolved;
}

void RenameOrFail(const fs::path& from, const fs::path& to) {
  std::error_code error;
  fs::rename(from, to, error);
  if (error) Fail("cannot move {} to {}: {}", from.string(), to.string(), error.message());
}

// Puts `fresh` in the place of `out`, which is a result, and deletes the latter.
void Exchange(const fs::path& fresh, const fs::path& out) {
  if (renameat2(AT_FDCWD, fresh.c_str(), AT_FDCWD, out.c_str(), RENAME_EXCHANGE) == 0) {
    fs::remove_all(fresh);
    return;
  }
  if (errno != EINVAL && errno != ENOSYS) {
    Fail("cannot replace {}: {}", out.string(), std::strerror(errno));
  }
  // A file system that cannot exchange: for a moment there is no `out`, never half of one.
  const fs::path aside = out.string() + ".old-" + std::to_string(getpid());
  RenameOrFail(out, aside);
  RenameOrFail(fresh, out);
  fs::remove_all(aside);
}

}  // namespace

AtomicDirectory::AtomicDirectory(const fs::path& out) {
  try {
    out_ = Resolve(out);
    partial_ = out_.string() + ".partial";
    RequireReplaceable(out_);
    RequireReplaceable(partial_);
    if (fs::exists(partial_)) {
      const int lock = LockFolder(partial_);
      fs::remove_all(partial_);
      close(lock);
    }
    fs::create_directories(partial_);
  } catch (const fs::filesystem_error& error) {
    Fail("cannot prepare the output folder {}: {}", out.string(), error.code().message());
  }
  lock_ = LockFolder(partial_);
  if (!std::ofstream(partial_ / kMarker)) {
    close(lock_);
    Fail("cannot write into {}", partial_.string());
  }
}

AtomicDirectory::~AtomicDirectory() { close(lock_); }

void AtomicDirectory::Commit() {
  try {
    RequireReplaceable(out_);
    fs::remove(partial_ / kMarker);
    if (fs::exists(out_)) {
      Exchange(partial_, out_);
    } else {
      RenameOrFail(partial_, out_);
    }
  } catch (const fs::filesystem_error& error) {
    Fail("cannot replace {}: {}", out_.string(), error.code().message());
  }
}

}  // namespace airslam
