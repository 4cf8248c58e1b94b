// SPDX-License-Identifier: BSD-3-Clause
//
// The tables of a map file, version 3. docs/map_format.md explains them.
#pragma once

#include <array>
#include <cstdint>
#include <span>

namespace airslam {

// PRAGMA application_id of a map: "ASLM".
inline constexpr std::int64_t kMapApplicationId = 0x41534c4d;

// Every row ends with row_checksum (map/sqlite.h) of its other columns, in their order: what a disk
// or a transfer has changed is noticed, also within a BLOB.
//
// What local bundle adjustment rewrites (poses, observations, landmarks) stands in tables of its
// own, apart from the large BLOBs that never change.
inline constexpr char kMapSchema[] = R"sql(
CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL, checksum INTEGER NOT NULL)
STRICT, WITHOUT ROWID;
CREATE TABLE calibration (
  id INTEGER PRIMARY KEY CHECK (id = 1),
  fx REAL NOT NULL, fy REAL NOT NULL, cx REAL NOT NULL, cy REAL NOT NULL,
  width INTEGER NOT NULL, height INTEGER NOT NULL, baseline REAL NOT NULL,
  body_from_left_qw REAL NOT NULL, body_from_left_qx REAL NOT NULL,
  body_from_left_qy REAL NOT NULL, body_from_left_qz REAL NOT NULL,
  body_from_left_tx REAL NOT NULL, body_from_left_ty REAL NOT NULL,
  body_from_left_tz REAL NOT NULL,
  has_imu INTEGER NOT NULL,
  checksum INTEGER NOT NULL
) STRICT;
CREATE TABLE keyframes (
  id INTEGER PRIMARY KEY,
  timestamp_ns INTEGER NOT NULL,
  component INTEGER NOT NULL,
  qw REAL NOT NULL, qx REAL NOT NULL, qy REAL NOT NULL, qz REAL NOT NULL,
  tx REAL NOT NULL, ty REAL NOT NULL, tz REAL NOT NULL,
  inertial_state BLOB,
  checksum INTEGER NOT NULL
) STRICT;
CREATE TABLE features (
  keyframe_id INTEGER PRIMARY KEY REFERENCES keyframes (id),
  keypoints BLOB NOT NULL,
  right_x BLOB NOT NULL,
  descriptor_scale REAL NOT NULL,
  descriptors BLOB NOT NULL,
  lines BLOB,
  junctions BLOB,
  junction_descriptor_scale REAL,
  junction_descriptors BLOB,
  right_lines BLOB,
  checksum INTEGER NOT NULL
) STRICT;
CREATE TABLE observations (
  keyframe_id INTEGER PRIMARY KEY REFERENCES keyframes (id),
  landmarks BLOB NOT NULL,
  line_landmarks BLOB,
  checksum INTEGER NOT NULL
) STRICT;
CREATE TABLE landmarks (
  id INTEGER PRIMARY KEY,
  x REAL NOT NULL, y REAL NOT NULL, z REAL NOT NULL,
  first_seen_by INTEGER NOT NULL REFERENCES keyframes (id),
  checksum INTEGER NOT NULL
) STRICT;
CREATE TABLE line_landmarks (
  id INTEGER PRIMARY KEY,
  x1 REAL NOT NULL, y1 REAL NOT NULL, z1 REAL NOT NULL,
  x2 REAL NOT NULL, y2 REAL NOT NULL, z2 REAL NOT NULL,
  first_seen_by INTEGER NOT NULL REFERENCES keyframes (id),
  checksum INTEGER NOT NULL
) STRICT;
)sql";

// Every table with its key, in the order in which the digest takes them.
struct MapTable {
  const char* name;
  const char* key;
};
inline constexpr std::array<MapTable, 7> kMapTables = {{{"meta", "key"},
                                                        {"calibration", "id"},
                                                        {"keyframes", "id"},
                                                        {"features", "keyframe_id"},
                                                        {"observations", "keyframe_id"},
                                                        {"landmarks", "id"},
                                                        {"line_landmarks", "id"}}};

// Those of a version of the format.
inline std::span<const MapTable> MapTables(std::int64_t version) {
  return std::span(kMapTables).first(version >= 2 ? 7 : 6);
}

// What WritePlaceRecord adds; maps without these tables are complete too.
inline constexpr char kPlaceSchema[] = R"sql(
CREATE TABLE IF NOT EXISTS vocabulary (
  kind TEXT PRIMARY KEY CHECK (kind IN ('keypoints', 'junctions')),
  sha256 TEXT NOT NULL,
  content BLOB,
  checksum INTEGER NOT NULL
) STRICT;
CREATE TABLE IF NOT EXISTS bag_of_words (
  keyframe_id INTEGER PRIMARY KEY REFERENCES keyframes (id),
  keypoint_words BLOB NOT NULL,
  junction_words BLOB,
  checksum INTEGER NOT NULL
) STRICT;
CREATE TABLE IF NOT EXISTS covisibility (
  keyframe_a INTEGER NOT NULL REFERENCES keyframes (id),
  keyframe_b INTEGER NOT NULL REFERENCES keyframes (id),
  shared INTEGER NOT NULL CHECK (shared > 0),
  checksum INTEGER NOT NULL,
  PRIMARY KEY (keyframe_a, keyframe_b), CHECK (keyframe_a < keyframe_b)
) STRICT, WITHOUT ROWID;
DELETE FROM vocabulary;
DELETE FROM bag_of_words;
DELETE FROM covisibility;
)sql";

// What the IMU read between keyframes. Maps without this table have no readings.
inline constexpr char kImuSchema[] = R"sql(
CREATE TABLE IF NOT EXISTS imu_readings (
  keyframe_id INTEGER PRIMARY KEY REFERENCES keyframes (id),
  noise BLOB NOT NULL,
  samples BLOB NOT NULL,
  checksum INTEGER NOT NULL
) STRICT;
)sql";
inline constexpr MapTable kImuTable = {"imu_readings", "keyframe_id"};

// These tables in the order in which the digest takes them, where they exist.
inline constexpr std::array<MapTable, 3> kPlaceTables = {
    {{"vocabulary", "kind"},
     {"bag_of_words", "keyframe_id"},
     {"covisibility", "keyframe_a, keyframe_b"}}};

}  // namespace airslam
