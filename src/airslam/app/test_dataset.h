// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/format.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "airslam/app/test_program.h"
#include "airslam/sensor/temporary_folder.h"
#include "airslam/testing/dataset_writer.h"

namespace airslam {

inline constexpr int kTestFrames = 20;

// A short synthetic sequence, on disk as a EuRoC folder, and what the program made of it. Made when
// first asked for, shared by the tests of a test program, none of which may change it.
class TestDataset {
 public:
  static const TestDataset& Get() {
    static const TestDataset dataset;
    return dataset;
  }

  const SyntheticSequence& sequence() const { return sequence_; }
  std::filesystem::path euroc() const { return folder_.path() / "euroc"; }
  // The results of `airslam map`, and what it said.
  std::filesystem::path result() const { return folder_.path() / "result"; }
  const ProgramResult& run() const { return run_; }

 private:
  TestDataset() : sequence_(Options()) {
    WriteEurocFolder(sequence_, euroc());
    run_ = RunProgram(folder_.path(), {"map", euroc().string(), "--out", result().string()});
  }

  static SyntheticSequenceOptions Options() {
    SyntheticSequenceOptions options;
    options.frames = kTestFrames;
    return options;
  }

  TemporaryFolder folder_;
  SyntheticSequence sequence_;
  ProgramResult run_;
};

inline void CopyFolder(const std::filesystem::path& from, const std::filesystem::path& to) {
  std::filesystem::copy(from, to, std::filesystem::copy_options::recursive);
}

// A copy of the shared EuRoC folder that a test may spoil.
inline std::filesystem::path CopyOfEuroc(const TemporaryFolder& folder) {
  const std::filesystem::path copy = folder.path() / "euroc";
  CopyFolder(TestDataset::Get().euroc(), copy);
  return copy;
}

// An image of the folder.
inline std::filesystem::path EurocImage(const std::filesystem::path& euroc, int camera, int index) {
  return euroc / fmt::format("mav0/cam{}/data/{}.png", camera,
                             TestDataset::Get().sequence().timestamp_ns(index));
}

// Replaces the image lists of both cameras: `frames` images at 10 Hz, named by `file_of`.
inline void ListImages(const std::filesystem::path& euroc, int frames,
                       const std::function<std::string(int)>& file_of) {
  const std::int64_t start = TestDataset::Get().sequence().timestamp_ns(0);
  for (const char* camera : {"cam0", "cam1"}) {
    std::ofstream csv(euroc / "mav0" / camera / "data.csv");
    for (int i = 0; i < frames; ++i) csv << start + i * 100'000'000LL << ',' << file_of(i) << '\n';
  }
}

// Replaces the only occurrence of `from` in a text file.
inline void ReplaceInFile(const std::filesystem::path& file, const std::string& from,
                          const std::string& to) {
  std::string text = ReadText(file);
  const std::size_t at = text.find(from);
  if (at == std::string::npos) throw std::runtime_error(from + " is not in " + file.string());
  std::ofstream(file, std::ios::binary) << text.replace(at, from.size(), to);
}

}  // namespace airslam
