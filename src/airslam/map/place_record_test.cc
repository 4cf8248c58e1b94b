// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/map/place_record.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "airslam/map/map_file.h"
#include "airslam/map/test_map.h"
#include "airslam/sensor/temporary_folder.h"

namespace airslam {
namespace {

// Of a map of three keyframes, the first two of which see the same.
PlaceRecord TestRecord() {
  PlaceRecord record;
  record.vocabulary_sha256 = "abc";
  record.words = {{0, {{1, 65535, 3}, {7, 8}}}, {1, {{4}, {}}}, {2, {{}, {}}}};
  record.junction_vocabulary = {std::byte{1}, std::byte{255}};
  record.covisibility = {{0, {{1, 12}}}, {1, {{0, 12}}}, {2, {}}};
  return record;
}

class PlaceRecordTest : public testing::Test {
 protected:
  PlaceRecordTest()
      : file_(folder_.path() / "map.db"), writer_(file_, TestCalibration(), "p", "s") {
    for (KeyframeId id = 0; id < 3; ++id) writer_.AddKeyframe(TestKeyframe(id, 3, 10 * id), {});
  }

  const TemporaryFolder folder_;
  const std::filesystem::path file_;
  MapWriter writer_;
};

TEST_F(PlaceRecordTest, ComesBackAsWritten) {
  EXPECT_FALSE(ReadPlaceRecord(file_).has_value());
  const PlaceRecord record = TestRecord();
  writer_.WritePlaceRecord(record);
  const auto read = ReadPlaceRecord(file_);
  ASSERT_TRUE(read.has_value());
  EXPECT_EQ(read->vocabulary_sha256, record.vocabulary_sha256);
  EXPECT_EQ(read->words, record.words);
  EXPECT_EQ(read->junction_vocabulary, record.junction_vocabulary);
  EXPECT_EQ(read->covisibility, record.covisibility);
  EXPECT_EQ(ReadMap(file_).keyframes.size(), 3U);
}

TEST_F(PlaceRecordTest, ReplacesAnEarlierOneAndEntersTheDigest) {
  const std::string without = MapDigest(file_);
  PlaceRecord record = TestRecord();
  writer_.WritePlaceRecord(record);
  const std::string first = MapDigest(file_);
  EXPECT_NE(first, without);
  record.words.erase(2);
  record.junction_vocabulary.clear();
  writer_.WritePlaceRecord(record);
  EXPECT_NE(MapDigest(file_), first);
  EXPECT_EQ(ReadPlaceRecord(file_)->words, record.words);
  EXPECT_TRUE(ReadPlaceRecord(file_)->junction_vocabulary.empty());
  writer_.WritePlaceRecord(TestRecord());
  EXPECT_EQ(MapDigest(file_), first);
}

TEST_F(PlaceRecordTest, RefusesKeyframesThatAreNotInTheMap) {
  PlaceRecord record = TestRecord();
  record.words[9] = {};
  EXPECT_THAT(ErrorOf([&] { writer_.WritePlaceRecord(record); }), testing::HasSubstr("map.db"));
  EXPECT_FALSE(ReadPlaceRecord(file_).has_value());  // nothing of it stays behind
}

}  // namespace
}  // namespace airslam
