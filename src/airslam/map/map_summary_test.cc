// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/map/map_summary.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "airslam/map/test_map.h"
#include "airslam/sensor/temporary_folder.h"

namespace airslam {
namespace {

using ::testing::HasSubstr;

// Keyframes 0 and 1 of component 0, one metre apart, share four of their landmarks; keyframe 2 is
// alone in component 1, far away.
void WriteMap(const std::filesystem::path& file) {
  MapWriter writer(file, TestCalibration(), "pack", "abc123");
  for (KeyframeId id = 0; id < 3; ++id) {
    Keyframe keyframe = TestKeyframe(id, 5, id == 2 ? 100 : 0);
    keyframe.component = id == 2 ? 1 : 0;
    keyframe.world_from_cam.translation = {id == 2 ? 500.0 : 1.0 * id, 0, 0};
    // All see line landmark 3 or 4.
    keyframe.lines.resize(2);
    keyframe.right_lines.resize(2);
    keyframe.line_landmarks = {id == 2 ? 4 : 3, kNoLandmark};
    keyframe.junctions.resize(1);
    keyframe.junction_descriptors = DescriptorMatrix::Ones(1, 64);
    std::vector<LineLandmark> line_landmarks;
    if (id != 1) line_landmarks.push_back({id == 2 ? 4 : 3, {{0, 0, 1}, {0, 0, 2}}, id});
    writer.AddKeyframe(keyframe, id == 1 ? std::vector<Landmark>() : TestLandmarks(keyframe),
                       line_landmarks);
  }
  writer.Close();
}

TEST(MapSummaryTest, CountsAndMeasures) {
  const TemporaryFolder folder;
  const auto file = folder.path() / "map.db";
  WriteMap(file);
  const MapSummary summary = SummarizeMap(file);
  EXPECT_EQ(summary.format_version, 3);
  EXPECT_EQ(summary.digest, MapDigest(file));
  EXPECT_EQ(summary.model_pack, "pack");
  EXPECT_EQ(summary.keyframes, 3);
  EXPECT_EQ(summary.components, 2);
  EXPECT_DOUBLE_EQ(summary.time_span_s, 0.1);
  EXPECT_DOUBLE_EQ(summary.path_length_m, 1);
  EXPECT_EQ(summary.landmarks, 8);
  EXPECT_DOUBLE_EQ(summary.observations_per_landmark, 12.0 / 8);
  EXPECT_EQ(summary.keypoints, 15);
  EXPECT_EQ(summary.line_landmarks, 2);
  EXPECT_DOUBLE_EQ(summary.observations_per_line_landmark, 1.5);
  EXPECT_EQ(summary.lines, 6);
  EXPECT_EQ(summary.junctions, 3);
  EXPECT_EQ(summary.file_bytes, static_cast<std::int64_t>(std::filesystem::file_size(file)));
  EXPECT_DOUBLE_EQ(summary.bytes_per_keyframe, static_cast<double>(summary.file_bytes) / 3);
}

TEST(MapSummaryTest, EmptyMap) {
  const TemporaryFolder folder;
  const auto file = folder.path() / "map.db";
  WriteTestMap(file, 0, 0);
  const MapSummary summary = SummarizeMap(file);
  EXPECT_EQ(summary.keyframes, 0);
  EXPECT_EQ(summary.bytes_per_keyframe, 0);
  EXPECT_EQ(summary.observations_per_landmark, 0);
}

TEST(MapSummaryTest, TextAndJsonSayTheSame) {
  const TemporaryFolder folder;
  const auto file = folder.path() / "map.db";
  WriteMap(file);
  const MapSummary summary = SummarizeMap(file);
  const std::string text = FormatMapSummary(summary);
  EXPECT_THAT(text, HasSubstr("keyframes       3 in 2 components\n"));
  EXPECT_THAT(text, HasSubstr("landmarks       8, seen by 1.50 keyframes each\n"));
  EXPECT_THAT(text, HasSubstr("path length     1.000 m\n"));
  EXPECT_THAT(text, HasSubstr("752x480 pixels, fx 458.654"));
  EXPECT_THAT(text, HasSubstr("model pack      pack (abc123)\n"));
  EXPECT_THAT(text, HasSubstr("line landmarks  2, seen by 1.50 keyframes each\n"));
  EXPECT_THAT(text, HasSubstr("lines           6 with 3 junctions\n"));
  const nlohmann::json json = MapSummaryToJson(summary);
  EXPECT_EQ(json["keyframes"], 3);
  EXPECT_EQ(json["components"], 2);
  EXPECT_EQ(json["landmarks"], 8);
  EXPECT_EQ(json["line_landmarks"], 2);
  EXPECT_EQ(json["lines"], 6);
  EXPECT_EQ(json["junctions"], 3);
  EXPECT_EQ(json["model_pack"]["sha256"], "abc123");
  EXPECT_EQ(json["calibration"]["baseline_m"], 0.110073808);
  EXPECT_EQ(json["digest"], summary.digest);
}

}  // namespace
}  // namespace airslam
