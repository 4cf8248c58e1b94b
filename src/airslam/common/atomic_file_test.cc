// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/common/atomic_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <iterator>
#include <string>

#include "airslam/common/error.h"

namespace airslam {
namespace {

namespace fs = std::filesystem;

class AtomicFileTest : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "airslam_atomic_XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    folder_ = name;
  }
  void TearDown() override { fs::remove_all(folder_); }
  static void Write(const fs::path& file, const std::string& text) { std::ofstream(file) << text; }
  static std::string Read(const fs::path& file) {
    std::ifstream stream(file);
    return {std::istreambuf_iterator<char>(stream), {}};
  }
  fs::path folder_;
};

TEST_F(AtomicFileTest, AppearsAsAWholeAndReplacesTheEarlierOne) {
  const fs::path file = folder_ / "new" / "map.db";
  fs::create_directories(file.parent_path());
  Write(file, "old");
  AtomicFile atomic(file);
  Write(atomic.partial(), "new");
  EXPECT_EQ(Read(file), "old");
  atomic.Commit();
  EXPECT_EQ(Read(file), "new");
  EXPECT_FALSE(fs::exists(atomic.partial()));
}

TEST_F(AtomicFileTest, LeavesTheEarlierOneWithoutCommit) {
  const fs::path file = folder_ / "map.db";
  Write(file, "old");
  {
    AtomicFile atomic(file);
    Write(atomic.partial(), "half");
  }
  EXPECT_EQ(Read(file), "old");
  EXPECT_FALSE(fs::exists(file.string() + ".partial"));
}

TEST_F(AtomicFileTest, SaysWhyItCannotWrite) {
  EXPECT_THROW(AtomicFile{folder_}, Error);
  Write(folder_ / "file", "");
  EXPECT_THROW(AtomicFile{folder_ / "file" / "map.db"}, Error);
}

}  // namespace
}  // namespace airslam
