// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/common/atomic_directory.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>
#include <functional>
#include <string>

#include "airslam/common/error.h"

namespace airslam {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

std::string ErrorOf(const std::function<void()>& call) {
  try {
    call();
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

void Write(const fs::path& file, const std::string& text) { std::ofstream(file) << text; }

std::string Read(const fs::path& file) {
  std::ifstream stream(file);
  return {std::istreambuf_iterator<char>(stream), {}};
}

class AtomicDirectoryTest : public testing::Test {
 protected:
  AtomicDirectoryTest() { fs::create_directories(root_); }
  ~AtomicDirectoryTest() override { fs::remove_all(root_); }

  const fs::path root_ = fs::path(testing::TempDir()) /
                         fmt::format("atomic_directory_{}_{}", getpid(),
                                     testing::UnitTest::GetInstance()->current_test_info()->name());
  const fs::path out_ = root_ / "new" / "out";
};

TEST_F(AtomicDirectoryTest, AppearsOnCommitWithNothingElse) {
  AtomicDirectory directory(out_);
  EXPECT_EQ(directory.partial(), root_ / "new" / "out.partial");
  Write(directory.partial() / "report.json", "1");
  EXPECT_FALSE(fs::exists(out_));
  directory.Commit();
  EXPECT_EQ(Read(out_ / "report.json"), "1");
  EXPECT_FALSE(fs::exists(directory.partial()));
  EXPECT_EQ(std::distance(fs::directory_iterator(out_), {}), 1);
}

TEST_F(AtomicDirectoryTest, ReplacesAnEarlierResultAsAWhole) {
  fs::create_directories(out_);
  Write(out_ / "report.json", "old");
  Write(out_ / "left_over.txt", "old");
  AtomicDirectory directory(out_.string() + "/");
  Write(directory.partial() / "report.json", "new");
  EXPECT_EQ(Read(out_ / "report.json"), "old");
  directory.Commit();
  EXPECT_EQ(Read(out_ / "report.json"), "new");
  EXPECT_FALSE(fs::exists(out_ / "left_over.txt"));
  EXPECT_FALSE(fs::exists(directory.partial()));
}

TEST_F(AtomicDirectoryTest, WithoutCommitBothStay) {
  fs::create_directories(out_);
  Write(out_ / "map.db", "old");
  { Write(AtomicDirectory(out_).partial() / "map.db", "half"); }
  EXPECT_EQ(Read(out_ / "map.db"), "old");
  EXPECT_EQ(Read(root_ / "new" / "out.partial" / "map.db"), "half");
  AtomicDirectory next(out_);
  EXPECT_FALSE(fs::exists(next.partial() / "map.db"));
}

TEST_F(AtomicDirectoryTest, ReplacesAnEmptyFolder) {
  fs::create_directories(out_);
  AtomicDirectory directory(out_);
  Write(directory.partial() / "report.json", "new");
  directory.Commit();
  EXPECT_EQ(Read(out_ / "report.json"), "new");
}

TEST_F(AtomicDirectoryTest, FollowsALinkToTheFolder) {
  fs::create_directories(root_ / "real");
  Write(root_ / "real" / "report.json", "old");
  fs::create_directory_symlink(root_ / "real", root_ / "link");
  AtomicDirectory directory(root_ / "link");
  Write(directory.partial() / "report.json", "new");
  directory.Commit();
  EXPECT_TRUE(fs::is_symlink(root_ / "link"));
  EXPECT_EQ(Read(root_ / "real" / "report.json"), "new");
}

TEST_F(AtomicDirectoryTest, RefusesAFolderOfOtherThings) {
  fs::create_directories(out_);
  Write(out_ / "thesis.tex", "years of work");
  EXPECT_THAT(ErrorOf([&] { AtomicDirectory directory(out_); }), HasSubstr("holds other files"));
  EXPECT_EQ(Read(out_ / "thesis.tex"), "years of work");
  EXPECT_FALSE(fs::exists(out_.string() + ".partial"));
}

TEST_F(AtomicDirectoryTest, RefusesOtherThingsThatAppearedDuringTheRun) {
  AtomicDirectory directory(out_);
  fs::create_directories(out_);
  Write(out_ / "thesis.tex", "years of work");
  EXPECT_THAT(ErrorOf([&] { directory.Commit(); }), HasSubstr("holds other files"));
  EXPECT_EQ(Read(out_ / "thesis.tex"), "years of work");
}

TEST_F(AtomicDirectoryTest, RefusesAPartialFolderOfOtherThings) {
  fs::create_directories(out_.string() + ".partial");
  Write(out_.string() + ".partial/thesis.tex", "years of work");
  EXPECT_THAT(ErrorOf([&] { AtomicDirectory directory(out_); }), HasSubstr("out.partial holds"));
  EXPECT_EQ(Read(out_.string() + ".partial/thesis.tex"), "years of work");
}

TEST_F(AtomicDirectoryTest, RefusesAFileAndAPlaceBelowAFile) {
  Write(root_ / "file", "");
  EXPECT_THAT(ErrorOf([&] { AtomicDirectory directory(root_ / "file"); }),
              HasSubstr("is not a folder"));
  EXPECT_THAT(ErrorOf([&] { AtomicDirectory directory(root_ / "file" / "out"); }),
              HasSubstr("cannot prepare the output folder"));
  EXPECT_THAT(ErrorOf([&] { AtomicDirectory directory("/"); }), HasSubstr("cannot be an output"));
}

TEST_F(AtomicDirectoryTest, RefusesASecondWriter) {
  AtomicDirectory first(out_);
  EXPECT_THAT(ErrorOf([&] { AtomicDirectory second(out_); }), HasSubstr("another run is writing"));
}

}  // namespace
}  // namespace airslam
