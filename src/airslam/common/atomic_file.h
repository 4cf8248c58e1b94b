// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

namespace airslam {

// A file that appears as a whole: what is written goes to the sibling "<file>.partial", and
// Commit() puts that in the place of <file> in one step. Without Commit() an earlier <file> stays
// as it was and the partial one is removed.
class AtomicFile {
 public:
  // Creates the folder of <file>, and removes a partial file that a killed run has left. Throws
  // Error when <file> is a folder or the place cannot be written.
  explicit AtomicFile(const std::filesystem::path& file);
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  // "<file>.partial": write here and close it before Commit().
  const std::filesystem::path& partial() const { return partial_; }

  // Throws Error, leaving <file>, when it cannot be replaced.
  void Commit();

 private:
  std::filesystem::path file_, partial_;
};

}  // namespace airslam
