// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/common/sha256.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>

#include "airslam/common/error.h"

namespace airslam {
namespace {

// FIPS 180-2, appendix B.
constexpr char kAbc[] = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";

TEST(Sha256Test, KnownAnswerInPieces) {
  Sha256 sha;
  sha.Update("a");
  sha.Update("bc");
  EXPECT_EQ(sha.Hex(), kAbc);
}

TEST(Sha256Test, FileLongerThanTheBuffer) {
  const auto file = std::filesystem::path(testing::TempDir()) /
                    ("sha256_test_" + std::to_string(getpid()) + ".bin");
  const std::string content(200'001, 'x');
  std::ofstream(file, std::ios::binary) << content;
  Sha256 expected;
  expected.Update(content);
  EXPECT_EQ(FileSha256(file), expected.Hex());
  std::filesystem::remove(file);
}

TEST(Sha256Test, MissingFile) { EXPECT_THROW(FileSha256("/nonexistent/file"), Error); }

}  // namespace
}  // namespace airslam
