// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

namespace airslam {

// A folder of results that appears as a whole. Everything is written to the sibling
// "<out>.partial"; Commit() puts it in the place of <out> in one step, so that whoever looks at
// <out> sees the earlier result or the new one, never a mixture. A run that fails or is killed
// leaves the earlier <out> as it was, and what it had so far, map.db with every committed keyframe
// among it, in "<out>.partial" until the next run with the same <out> replaces that.
class AtomicDirectory {
 public:
  // Prepares an empty "<out>.partial", creating <out>'s parents. Throws Error when <out> is there
  // and is not a result of this program (a file, or a folder that is neither empty nor holds
  // report.json or map.db), when another running process is writing it, or when the place cannot
  // be written.
  explicit AtomicDirectory(const std::filesystem::path& out);
  ~AtomicDirectory();
  AtomicDirectory(const AtomicDirectory&) = delete;
  AtomicDirectory& operator=(const AtomicDirectory&) = delete;

  // "<out>.partial": write here, until Commit().
  const std::filesystem::path& partial() const { return partial_; }

  // Close every file below partial() first. Throws Error, leaving both folders, when <out> cannot
  // be replaced.
  void Commit();

 private:
  std::filesystem::path out_;
  std::filesystem::path partial_;
  int lock_ = -1;  // descriptor of the partial folder, locked while this object lives
};

}  // namespace airslam
