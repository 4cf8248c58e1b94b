// SPDX-License-Identifier: BSD-3-Clause
//
// Map files that are missing, foreign, newer, truncated, damaged or left behind by a killed
// process.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <fstream>
#include <functional>
#include <random>

#include "airslam/common/error.h"
#include "airslam/map/map_file.h"
#include "airslam/map/sqlite.h"
#include "airslam/map/test_map.h"
#include "airslam/sensor/temporary_folder.h"

namespace airslam {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::StartsWith;

std::string ReadBytes(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

class MapDamageTest : public testing::Test {
 protected:
  // What reading the file fails with; both readers must say the same. Empty: it is read.
  std::string ErrorOfReading() const {
    const std::string error = ErrorOf([&] { ReadMap(file_); });
    EXPECT_EQ(ErrorOf([&] { MapDigest(file_); }), error);
    return error;
  }
  std::string ErrorAfter(const std::string& sql) const {
    fs::remove(file_);
    WriteTestMap(file_, 2, 10);
    SqliteDatabase(file_, SqliteDatabase::Mode::kCreate).Execute(sql);
    return ErrorOf([&] { ReadMap(file_); });
  }

  const TemporaryFolder folder_;
  const fs::path file_ = folder_.path() / "map.db";
  const std::string damaged_ = "map file " + file_.string() + " is truncated or damaged: ";
};

TEST_F(MapDamageTest, NotThereOrNotAFile) {
  EXPECT_EQ(ErrorOfReading(), "map file " + file_.string() + " does not exist");
  fs::create_directory(file_);
  EXPECT_EQ(ErrorOfReading(), file_.string() + " is a folder, not a map file");
}

TEST_F(MapDamageTest, NotSqlite) {
  folder_.Write("map.db", "");
  EXPECT_EQ(ErrorOfReading(), "map file " + file_.string() + " is empty");
  folder_.Write("map.db", "SQLite");
  EXPECT_EQ(ErrorOfReading(), "map file " + file_.string() + " is truncated");
  folder_.Write("map.db", std::string(5000, 'x'));
  EXPECT_EQ(ErrorOfReading(), file_.string() + " is not a map: it is not an SQLite file");
}

TEST_F(MapDamageTest, AnotherProgramsDatabase) {
  SqliteDatabase(file_, SqliteDatabase::Mode::kCreate).Execute("CREATE TABLE notes (text)");
  EXPECT_EQ(ErrorOfReading(), file_.string() +
                                  " is not a map: it is an SQLite file of something "
                                  "else");
}

TEST_F(MapDamageTest, NewerVersion) {
  EXPECT_EQ(ErrorAfter("PRAGMA user_version = 7"),
            "map file " + file_.string() +
                " is of format 7, written by a newer version; this program reads up to 3");
  EXPECT_EQ(ErrorAfter("PRAGMA user_version = 0"), damaged_ + "it claims to be of format 0");
}

TEST_F(MapDamageTest, InconsistentRows) {
  EXPECT_EQ(ErrorAfter(""), "");
  const auto expect = [&](const std::string& sql, const std::string& reason) {
    EXPECT_EQ(ErrorAfter(sql), damaged_ + reason);
  };
  expect("DELETE FROM calibration", "the calibration is missing");
  expect("DELETE FROM meta", "the entry model_pack is missing");
  expect("DROP TABLE landmarks", "no such table: landmarks");
  expect("DELETE FROM features WHERE keyframe_id = 1", "1 keyframes have lost their features");
  expect("UPDATE keyframes SET qw = qw + 0.1", "a pose is not a rigid transform");
  expect("UPDATE keyframes SET component = 3000000000", "the number 3000000000 is out of range");
  expect("UPDATE keyframes SET inertial_state = zeroblob(80)",
         "keyframe 0 has 10 inertial values, not 9");
  expect("UPDATE features SET keypoints = zeroblob(7)",
         "an array of 7 bytes is not made of elements of 12 bytes");
  expect("UPDATE features SET right_x = zeroblob(36)", "keyframe 0 has 9 right columns, not 10");
  expect("UPDATE features SET descriptors = zeroblob(639)",
         "descriptors of 639 bytes are not those of 10 keypoints");
  expect("UPDATE features SET lines = zeroblob(20)", "keyframe 0 has 0 line ids, not 1");
  expect(
      "UPDATE features SET lines = zeroblob(20), right_lines = zeroblob(40);"
      "UPDATE observations SET line_landmarks = zeroblob(8)",
      "keyframe 0 has 2 right lines, not 1");
  expect("DROP TABLE line_landmarks", "no such table: line_landmarks");
  expect("INSERT INTO line_landmarks VALUES (0, 1, 2, 3, 4, 5, 6, 77, 0)",
         "line landmark 0 is not valid");
  expect("INSERT INTO line_landmarks VALUES (0, 1, 2, 3, 1, 2, 3, 0, 0)",
         "line landmark 0 is not valid");
  expect("UPDATE features SET junction_descriptors = zeroblob(64)",
         "descriptors of 64 bytes are not those of 0 keypoints");
  expect("UPDATE observations SET landmarks = zeroblob(72)",
         "keyframe 0 has 9 landmark ids, not 10");
  expect("UPDATE landmarks SET first_seen_by = 77 WHERE id = 3", "landmark 3 is not valid");
  expect("UPDATE landmarks SET x = 9e999 WHERE id = 3", "landmark 3 is not valid");
}

TEST_F(MapDamageTest, TruncatedAnywhere) {
  WriteTestMap(file_, 12, 60);
  const std::string whole = ReadBytes(file_);
  ASSERT_GT(whole.size(), 80'000u);
  std::vector<std::size_t> lengths = {1, 15, 16, 17, 50, 99, 100, 101, 512, 4095, 4096, 4097};
  for (std::size_t n = 8192; n < whole.size(); n += 4096) lengths.push_back(n);
  for (std::size_t n = 5000; n < whole.size(); n += 7919) lengths.push_back(n);
  lengths.push_back(whole.size() - 1);
  for (const std::size_t length : lengths) {
    folder_.Write("map.db", whole.substr(0, length));
    EXPECT_THAT(ErrorOfReading(), StartsWith("map file " + file_.string() + " is truncated"))
        << length;
  }
  folder_.Write("map.db", whole);
  EXPECT_EQ(ErrorOfReading(), "");
}

// What a map holds, descriptors and all, as text.
std::string ContentOf(const fs::path& file) {
  const Map map = ReadMap(file);
  std::string text = MapDigest(file);
  for (const auto& [id, keyframe] : map.keyframes) {
    text += fmt::format(" {} {} {} {}", id, keyframe.timestamp_ns, keyframe.keypoints.size(),
                        keyframe.descriptors.sum());
  }
  return text + fmt::format(" {} {}", map.landmarks.size(), map.line_landmarks.size());
}

// Whatever is overwritten: one sentence about the file, or the map as it was (unused bytes). Never
// a crash, never other content.
TEST_F(MapDamageTest, OverwrittenAnywhere) {
  WriteTestMap(file_, 3, 30);
  const std::string content = ContentOf(file_);
  const std::string whole = ReadBytes(file_);
  std::mt19937 random(5);
  int refused = 0;
  for (int trial = 0; trial < 600; ++trial) {
    std::string bytes = whole;
    const std::size_t begin = random() % bytes.size();
    // A bit, a byte, or up to a few dozen bytes.
    const std::size_t end = std::min(bytes.size(), begin + 1 + random() % 64 * (trial % 3 / 2));
    for (std::size_t i = begin; i < end; ++i) {
      bytes[i] = trial % 3 == 0 ? static_cast<char>(bytes[i] ^ (1 << random() % 8))
                                : static_cast<char>(random());
    }
    folder_.Write("map.db", bytes);
    std::string read;
    const std::string error = ErrorOf([&] { read = ContentOf(file_); });
    if (error.empty()) {
      EXPECT_EQ(read, content) << "bytes " << begin << " to " << end;
    } else {
      ++refused;
      EXPECT_THAT(error, HasSubstr(file_.string()));
      EXPECT_EQ(error.find('\n'), std::string::npos) << error;
    }
  }
  EXPECT_GT(refused, 100);  // the rest hit bytes that hold nothing
}

// Numbers written by a machine of the other byte order.
TEST_F(MapDamageTest, SwappedBytesOfBlobsAreNoticed) {
  for (const char* column : {"keypoints", "right_x"}) {
    fs::remove(file_);
    WriteTestMap(file_, 2, 10);
    {
      SqliteDatabase database(file_, SqliteDatabase::Mode::kCreate);
      std::string bytes;
      {
        SqliteStatement read(database, fmt::format("SELECT hex({}) FROM features", column));
        ASSERT_TRUE(read.Step());
        bytes = read.Text(0);
      }
      for (std::size_t i = 0; i + 8 <= bytes.size(); i += 8) {  // 4 bytes, as hexadecimal digits
        std::swap_ranges(bytes.begin() + i, bytes.begin() + i + 2, bytes.begin() + i + 6);
        std::swap_ranges(bytes.begin() + i + 2, bytes.begin() + i + 4, bytes.begin() + i + 4);
      }
      database.Execute(
          fmt::format("UPDATE features SET {} = x'{}' WHERE keyframe_id = 0", column, bytes));
    }
    EXPECT_EQ(ErrorOfReading(), damaged_ + "1 of the rows of table features is not as written");
  }
}

TEST_F(MapDamageTest, EditedRowsAreNoticed) {
  EXPECT_EQ(ErrorAfter("UPDATE landmarks SET x = x + 0.001 WHERE id = 3"),
            damaged_ + "1 of the rows of table landmarks is not as written");
  EXPECT_EQ(ErrorAfter("UPDATE calibration SET baseline = 0.2"),
            damaged_ + "1 of the rows of table calibration is not as written");
  EXPECT_EQ(ErrorAfter("UPDATE meta SET value = 'other'"),
            damaged_ + "2 of the rows of table meta are not as written");
  EXPECT_EQ(ErrorAfter("PRAGMA user_version = 2"),
            damaged_ + "it claims to be of format 2, but is newer");
  // One who knows what he does can say so.
  EXPECT_EQ(ErrorAfter("UPDATE landmarks SET x = 1.5, checksum = row_checksum(id, 1.5, y, z, "
                       "first_seen_by) WHERE id = 3"),
            "");
}

// Runs `child` in a child process, which must not return, and hands `parent` its id and what it
// writes to its pipe.
void WithChild(const std::function<void(int pipe)>& child,
               const std::function<void(pid_t pid, int pipe)>& parent) {
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);
  const pid_t pid = fork();
  ASSERT_GE(pid, 0);
  if (pid == 0) {
    close(ends[0]);
    child(ends[1]);
    _exit(1);
  }
  close(ends[1]);
  parent(pid, ends[0]);
  close(ends[0]);
}

// Adds keyframes for ever, and writes a byte to the pipe after each that is committed.
[[noreturn]] void WriteForEver(const fs::path& file, int pipe) {
  MapWriter writer(file, TestCalibration(), "pack", "abc");
  for (KeyframeId id = 0;; ++id) {
    const Keyframe keyframe = TestKeyframe(id, 200, 1000 * id);
    writer.AddKeyframe(keyframe, TestLandmarks(keyframe));
    if (write(pipe, "k", 1) != 1) _exit(1);
    // Rewrite what is there, as local bundle adjustment does.
    MapWriter::Update update;
    for (KeyframeId old = std::max(0, id - 5); old <= id; ++old) {
      const Keyframe moved = TestKeyframe(old, 200, 1000 * old);
      update.world_from_cam.emplace_back(old, moved.world_from_cam);
      for (const Landmark& landmark : TestLandmarks(moved)) update.landmarks.push_back(landmark);
    }
    writer.Apply(update);
  }
}

// Kills a writing process after `acknowledged` keyframes and a little more.
void KillAWriter(const fs::path& file, int acknowledged, int more_us) {
  WithChild([&](int pipe) { WriteForEver(file, pipe); },
            [&](pid_t pid, int pipe) {
              char byte;
              for (int i = 0; i < acknowledged; ++i) ASSERT_EQ(read(pipe, &byte, 1), 1);
              usleep(static_cast<useconds_t>(more_us));
              kill(pid, SIGKILL);
              int status = 0;
              waitpid(pid, &status, 0);
              ASSERT_TRUE(WIFSIGNALED(status));
            });
}

TEST_F(MapDamageTest, KillLeavesEveryCommittedKeyframe) {
  for (int trial = 0; trial < 12; ++trial) {
    const fs::path file = folder_.path() / fmt::format("killed_{}.db", trial);
    const int acknowledged = 1 + 4 * trial;
    KillAWriter(file, acknowledged, 700 * trial);
    const Map map = ReadMap(file);
    EXPECT_GE(std::ssize(map.keyframes), acknowledged);
    for (const auto& [id, keyframe] : map.keyframes) {
      const Keyframe expected = TestKeyframe(id, 200, 1000 * id);
      EXPECT_EQ(keyframe.world_from_cam.translation, expected.world_from_cam.translation);
      EXPECT_EQ(keyframe.landmarks, expected.landmarks);
    }
    EXPECT_EQ(std::ssize(map.landmarks), 160 * std::ssize(map.keyframes));
  }
}

// As a user without any right to write there. Returns what reading fails with.
std::string ErrorOfReadingWithoutRights(const fs::path& file) {
  std::string error;
  WithChild(
      [&](int pipe) {
        if (geteuid() == 0 && (setgid(65534) != 0 || setuid(65534) != 0)) _exit(1);
        const std::string text = "read: " + ErrorOf([&] { ReadMap(file); });
        _exit(write(pipe, text.data(), text.size()) == std::ssize(text) ? 0 : 1);
      },
      [&](pid_t pid, int pipe) {
        char buffer[1000];
        for (ssize_t n; (n = read(pipe, buffer, sizeof(buffer))) > 0;) {
          error.append(buffer, static_cast<std::size_t>(n));
        }
        waitpid(pid, nullptr, 0);
      });
  return error;
}

TEST_F(MapDamageTest, ReadOnlyFolder) {
  const fs::path closed = folder_.path() / "closed";
  const fs::path killed = folder_.path() / "killed";
  const fs::path copied = folder_.path() / "copied";
  for (const fs::path& place : {closed, killed, copied}) fs::create_directory(place);
  WriteTestMap(closed / "map.db", 2, 10);
  KillAWriter(killed / "map.db", 3, 0);
  // As a person copies it: without the shared memory.
  fs::copy_file(killed / "map.db", copied / "map.db");
  fs::copy_file(killed / "map.db-wal", copied / "map.db-wal");
  const auto readable = fs::perms::owner_read | fs::perms::group_read | fs::perms::others_read;
  const auto enterable = fs::perms::owner_exec | fs::perms::group_exec | fs::perms::others_exec;
  fs::permissions(folder_.path(), fs::perms::owner_all | readable | enterable);
  for (const fs::path& place : {closed, killed, copied}) {
    for (const auto& entry : fs::directory_iterator(place)) fs::permissions(entry, readable);
    fs::permissions(place, readable | enterable);
    EXPECT_EQ(ErrorOfReadingWithoutRights(place / "map.db"), "read: ") << place;
  }
  fs::permissions(closed / "map.db", fs::perms::none);
  EXPECT_EQ(ErrorOfReadingWithoutRights(closed / "map.db"),
            "read: map file " + (closed / "map.db").string() + " cannot be opened");
  for (const fs::path& place : {closed, killed, copied}) {
    fs::permissions(place, fs::perms::owner_all);
  }
}

}  // namespace
}  // namespace airslam
