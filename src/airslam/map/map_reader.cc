// SPDX-License-Identifier: BSD-3-Clause
//
// The reading half of map_file.h.
#include <sqlite3.h>
#include <stdlib.h>

#include <cmath>
#include <fstream>
#include <limits>
#include <optional>

#include "airslam/common/error.h"
#include "airslam/common/sha256.h"
#include "airslam/map/map_codec.h"
#include "airslam/map/map_file.h"
#include "airslam/map/map_schema.h"
#include "airslam/map/sqlite.h"

namespace airslam {
namespace fs = std::filesystem;
namespace {

// A copy of a map file and its write-ahead log in a temporary folder that goes with this object.
class TemporaryCopy {
 public:
  explicit TemporaryCopy(const fs::path& file) {
    std::string name = (fs::temp_directory_path() / "airslam_map_XXXXXX").string();
    if (mkdtemp(name.data()) == nullptr) Fail("cannot make a temporary folder for a copy of a map");
    folder_ = name;
    for (const char* suffix : {"", "-wal"}) {
      const fs::path from = file.string() + suffix;
      if (!fs::exists(from)) continue;
      fs::copy_file(from, this->file().string() + suffix);
      fs::permissions(this->file().string() + suffix, fs::perms::owner_all);
    }
  }
  ~TemporaryCopy() {
    std::error_code ignored;
    fs::remove_all(folder_, ignored);
  }
  TemporaryCopy(const TemporaryCopy&) = delete;
  TemporaryCopy& operator=(const TemporaryCopy&) = delete;

  fs::path file() const { return folder_ / "map.db"; }

 private:
  fs::path folder_;
};

// An open map; `copy`, where needed, outlives the connection to it.
struct OpenMap {
  std::optional<TemporaryCopy> copy;
  std::optional<SqliteDatabase> database;
  std::int64_t version = 0;  // of the format
};

[[noreturn]] void FailDamaged(const fs::path& file, std::string_view reason) {
  Fail("map file {} is truncated or damaged: {}", file.string(), reason);
}

// Throws unless the file is there and begins as an SQLite file does.
void RequireSqliteFile(const fs::path& file) {
  std::error_code error;
  const fs::file_status status = fs::status(file, error);
  if (!fs::exists(status)) Fail("map file {} does not exist", file.string());
  if (fs::is_directory(status)) Fail("{} is a folder, not a map file", file.string());
  std::ifstream stream(file, std::ios::binary);
  if (!stream) Fail("map file {} cannot be opened", file.string());
  constexpr std::string_view kMagic("SQLite format 3\0", 16);
  std::string begin(kMagic.size(), '\0');
  stream.read(begin.data(), static_cast<std::streamsize>(begin.size()));
  begin.resize(static_cast<std::size_t>(stream.gcount()));
  if (begin.empty()) Fail("map file {} is empty", file.string());
  if (begin == kMagic) return;
  if (kMagic.starts_with(begin)) Fail("map file {} is truncated", file.string());
  Fail("{} is not a map: it is not an SQLite file", file.string());
}

// Throws SqliteError when SQLite cannot read the database.
void Connect(OpenMap& map, const fs::path& file) {
  map.database.emplace(file, SqliteDatabase::Mode::kReadOnly);
  map.database->QueryInteger("SELECT count(*) FROM sqlite_schema");
}

// The log of a writer that was killed needs a shared-memory file beside it; where that cannot be
// made, in a read-only folder, a copy is read.
void ConnectOrCopy(OpenMap& map, const fs::path& file) {
  try {
    Connect(map, file);
  } catch (const SqliteError& error) {
    if (error.result_code() != SQLITE_CANTOPEN && error.result_code() != SQLITE_READONLY) throw;
    map.database.reset();
    try {
      map.copy.emplace(file);
    } catch (const fs::filesystem_error& copy_error) {
      Fail("map file {} cannot be read: {}", file.string(), copy_error.code().message());
    }
    Connect(map, map.copy->file());
  }
}

// Returns the version.
std::int64_t RequireKnownVersion(SqliteDatabase& database, const fs::path& file) {
  if (database.QueryInteger("PRAGMA application_id") != kMapApplicationId) {
    Fail("{} is not a map: it is an SQLite file of something else", file.string());
  }
  const std::int64_t version = database.QueryInteger("PRAGMA user_version");
  if (version > kMapFormatVersion) {
    Fail("map file {} is of format {}, written by a newer version; this program reads up to {}",
         file.string(), version, kMapFormatVersion);
  }
  if (version < 1) FailDamaged(file, fmt::format("it claims to be of format {}", version));
  return version;
}

std::int32_t Int32(const SqliteStatement& row, int column) {
  const std::int64_t value = row.Integer(column);
  if (value < std::numeric_limits<std::int32_t>::min() ||
      value > std::numeric_limits<std::int32_t>::max()) {
    Fail("the number {} is out of range", value);
  }
  return static_cast<std::int32_t>(value);
}

// qw, qx, qy, qz, tx, ty, tz from `column` on, not normalised again: the bits are those written.
Rigid3 ReadPose(const SqliteStatement& row, int column) {
  Rigid3 pose;
  pose.rotation = Eigen::Quaterniond(row.Real(column), row.Real(column + 1), row.Real(column + 2),
                                     row.Real(column + 3));
  pose.translation = {row.Real(column + 4), row.Real(column + 5), row.Real(column + 6)};
  // Written so that a NaN fails too.
  if (!(std::abs(pose.rotation.norm() - 1) < 1e-6) || !pose.translation.allFinite()) {
    Fail("a pose is not a rigid transform");
  }
  return pose;
}

MapCalibration ReadCalibration(SqliteDatabase& database) {
  SqliteStatement row(database, "SELECT * FROM calibration");
  if (!row.Step()) Fail("the calibration is missing");
  MapCalibration calibration;
  Pinhole& camera = calibration.stereo.camera;
  camera.fx = row.Real(1);
  camera.fy = row.Real(2);
  camera.cx = row.Real(3);
  camera.cy = row.Real(4);
  camera.width = Int32(row, 5);
  camera.height = Int32(row, 6);
  calibration.stereo.baseline = row.Real(7);
  calibration.body_from_left = ReadPose(row, 8);
  calibration.has_imu = row.Integer(15) != 0;
  return calibration;
}

std::string ReadMeta(SqliteDatabase& database, std::string_view key) {
  SqliteStatement row(database, "SELECT value FROM meta WHERE key = ?1");
  row.Bind(1, key);
  if (!row.Step()) Fail("the entry {} is missing", key);
  return row.Text(0);
}

// The place {} is for what version 1 does not have.
constexpr char kReadKeyframes[] = R"sql(
SELECT k.id, k.timestamp_ns, k.component, k.qw, k.qx, k.qy, k.qz, k.tx, k.ty, k.tz,
       k.inertial_state, f.keypoints, f.right_x, f.descriptor_scale, f.descriptors, f.lines,
       f.junctions, f.junction_descriptor_scale, f.junction_descriptors, o.landmarks,
       o.line_landmarks, {}
FROM keyframes k JOIN features f ON f.keyframe_id = k.id
                 JOIN observations o ON o.keyframe_id = k.id
ORDER BY k.id
)sql";

void RequireSize(std::size_t size, std::size_t expected, KeyframeId id, const char* what) {
  if (size != expected) Fail("keyframe {} has {} {}, not {}", id, size, what, expected);
}

// From columns 11 to 21 of kReadKeyframes.
void ReadFeatures(const SqliteStatement& row, Keyframe& keyframe) {
  keyframe.keypoints = DecodeKeypoints(row.Blob(11));
  const std::size_t n = keyframe.keypoints.size();
  keyframe.right_x = DecodeArray<float>(row.Blob(12));
  RequireSize(keyframe.right_x.size(), n, keyframe.id, "right columns");
  keyframe.descriptors = RestoreDescriptors(row.Blob(14), row.Real(13), static_cast<int>(n));
  keyframe.landmarks = DecodeArray<LandmarkId>(row.Blob(19));
  RequireSize(keyframe.landmarks.size(), n, keyframe.id, "landmark ids");
  keyframe.lines = DecodeLines(row.Blob(15));
  keyframe.line_landmarks = DecodeArray<LandmarkId>(row.Blob(20));
  RequireSize(keyframe.line_landmarks.size(), keyframe.lines.size(), keyframe.id, "line ids");
  keyframe.right_lines = DecodeLines(row.Blob(21));
  if (row.IsNull(21)) keyframe.right_lines.resize(keyframe.lines.size(), kNoLine);
  RequireSize(keyframe.right_lines.size(), keyframe.lines.size(), keyframe.id, "right lines");
  keyframe.junctions = DecodeKeypoints(row.Blob(16));
  keyframe.junction_descriptors =
      RestoreDescriptors(row.Blob(18), row.Real(17), static_cast<int>(keyframe.junctions.size()));
}

void ReadInertialState(const SqliteStatement& row, Keyframe& keyframe) {
  if (row.IsNull(10)) return;
  const std::vector<double> state = DecodeArray<double>(row.Blob(10));
  RequireSize(state.size(), 9, keyframe.id, "inertial values");
  keyframe.has_inertial_state = true;
  keyframe.velocity_in_world = Eigen::Vector3d(state.data());
  keyframe.gyroscope_bias = Eigen::Vector3d(state.data() + 3);
  keyframe.accelerometer_bias = Eigen::Vector3d(state.data() + 6);
}

void ReadKeyframes(SqliteDatabase& database, std::int64_t version, Map& map) {
  SqliteStatement row(database,
                      fmt::format(kReadKeyframes, version >= 2 ? "f.right_lines" : "NULL"));
  while (row.Step()) {
    Keyframe keyframe;
    keyframe.id = Int32(row, 0);
    keyframe.timestamp_ns = row.Integer(1);
    keyframe.component = Int32(row, 2);
    keyframe.world_from_cam = ReadPose(row, 3);
    ReadInertialState(row, keyframe);
    ReadFeatures(row, keyframe);
    map.keyframes[keyframe.id] = std::move(keyframe);
  }
  const std::int64_t expected = database.QueryInteger("SELECT count(*) FROM keyframes");
  if (static_cast<std::int64_t>(map.keyframes.size()) != expected) {
    Fail("{} keyframes have lost their features", expected - std::ssize(map.keyframes));
  }
}

bool HasTable(SqliteDatabase& database, const char* name) {
  return database.QueryInteger(fmt::format(
             "SELECT count(*) FROM sqlite_schema WHERE type = 'table' AND name = '{}'", name)) > 0;
}

void ReadImuReadings(SqliteDatabase& database, Map& map) {
  if (!HasTable(database, kImuTable.name)) return;
  SqliteStatement row(database, "SELECT keyframe_id, noise, samples FROM imu_readings");
  while (row.Step()) {
    const auto keyframe = map.keyframes.find(Int32(row, 0));
    if (keyframe == map.keyframes.end()) Fail("readings belong to no keyframe");
    const std::vector<double> noise = DecodeArray<double>(row.Blob(1));
    RequireSize(noise.size(), 5, keyframe->first, "noise values");
    keyframe->second.imu_noise = {noise[0], noise[1], noise[2], noise[3], noise[4]};
    keyframe->second.imu_samples = DecodeImuSamples(row.Blob(2));
    std::int64_t last = std::numeric_limits<std::int64_t>::min();
    for (const ImuSample& sample : keyframe->second.imu_samples) {
      if (sample.timestamp_ns <= last || !sample.angular_velocity.allFinite() ||
          !sample.acceleration.allFinite()) {
        Fail("the readings of keyframe {} are not valid", keyframe->first);
      }
      last = sample.timestamp_ns;
    }
  }
}

void ReadLandmarks(SqliteDatabase& database, Map& map) {
  SqliteStatement row(database, "SELECT id, x, y, z, first_seen_by FROM landmarks ORDER BY id");
  while (row.Step()) {
    Landmark landmark;
    landmark.id = row.Integer(0);
    landmark.point_in_world = {row.Real(1), row.Real(2), row.Real(3)};
    landmark.first_seen_by = Int32(row, 4);
    if (!landmark.point_in_world.allFinite() || !map.keyframes.contains(landmark.first_seen_by)) {
      Fail("landmark {} is not valid", landmark.id);
    }
    map.landmarks[landmark.id] = landmark;
  }
}

void ReadLineLandmarks(SqliteDatabase& database, Map& map) {
  SqliteStatement row(
      database, "SELECT id, x1, y1, z1, x2, y2, z2, first_seen_by FROM line_landmarks ORDER BY id");
  while (row.Step()) {
    LineLandmark landmark;
    landmark.id = row.Integer(0);
    SpaceSegment& ends = landmark.ends_in_world;
    ends.start = {row.Real(1), row.Real(2), row.Real(3)};
    ends.end = {row.Real(4), row.Real(5), row.Real(6)};
    landmark.first_seen_by = Int32(row, 7);
    if (!ends.start.allFinite() || !ends.end.allFinite() || ends.start == ends.end ||
        !map.keyframes.contains(landmark.first_seen_by)) {
      Fail("line landmark {} is not valid", landmark.id);
    }
    map.line_landmarks[landmark.id] = landmark;
  }
}

// A landmark that was removed takes the observations with it.
void ForgetRemovedLandmarks(Map& map) {
  for (auto& [id, keyframe] : map.keyframes) {
    for (LandmarkId& landmark : keyframe.landmarks) {
      if (!map.landmarks.contains(landmark)) landmark = kNoLandmark;
    }
    for (LandmarkId& landmark : keyframe.line_landmarks) {
      if (!map.line_landmarks.contains(landmark)) landmark = kNoLandmark;
    }
  }
}

PlaceRecord ReadPlaceTables(SqliteDatabase& database) {
  PlaceRecord record;
  SqliteStatement vocabulary(database, "SELECT kind, sha256, content FROM vocabulary");
  while (vocabulary.Step()) {
    if (vocabulary.Text(0) == "keypoints") {
      record.vocabulary_sha256 = vocabulary.Text(1);
    } else {
      const auto content = vocabulary.Blob(2);
      record.junction_vocabulary.assign(content.begin(), content.end());
    }
  }
  SqliteStatement words(database,
                        "SELECT keyframe_id, keypoint_words, junction_words FROM bag_of_words");
  while (words.Step()) {
    record.words[Int32(words, 0)] = {DecodeArray<std::uint16_t>(words.Blob(1)),
                                     DecodeArray<std::uint16_t>(words.Blob(2))};
  }
  SqliteStatement id(database, "SELECT id FROM keyframes");
  while (id.Step()) record.covisibility[Int32(id, 0)] = {};
  SqliteStatement shared(database, "SELECT keyframe_a, keyframe_b, shared FROM covisibility");
  while (shared.Step()) {
    const KeyframeId a = Int32(shared, 0), b = Int32(shared, 1);
    if (!record.covisibility.contains(a) || !record.covisibility.contains(b)) {
      Fail("the co-visibility of keyframes {} and {} is not of this map", a, b);
    }
    record.covisibility[a][b] = record.covisibility[b][a] = Int32(shared, 2);
  }
  return record;
}

// SQLite reads what is missing of the last page as zeros. A file without a write-ahead log must
// have all its pages.
void RequireWholePages(OpenMap& map, const fs::path& file) {
  const fs::path connected = map.copy ? map.copy->file() : file;
  std::error_code error;
  if (fs::file_size(connected.string() + "-wal", error) > 0 && !error) return;
  const auto size = static_cast<std::int64_t>(fs::file_size(connected, error));
  const std::int64_t expected = map.database->QueryInteger("PRAGMA page_count") *
                                map.database->QueryInteger("PRAGMA page_size");
  if (!error && size < expected) {
    FailDamaged(file, fmt::format("it has {} bytes of {}", size, expected));
  }
}

// Connects, and checks that this is a map of a version that this program reads. What follows sees
// the map at one moment, also while a writer is at work.
void Open(OpenMap& map, const fs::path& file) {
  RequireSqliteFile(file);
  try {
    ConnectOrCopy(map, file);
    map.database->Execute("BEGIN");
    map.version = RequireKnownVersion(*map.database, file);
    RequireWholePages(map, file);
  } catch (const SqliteError& error) {
    FailDamaged(file, error.what());
  }
}

// The columns of a table but for its checksum, "a, b, c".
std::string ColumnsOf(SqliteDatabase& database, const char* table) {
  SqliteStatement info(database, fmt::format("SELECT name FROM pragma_table_info('{}') "
                                             "WHERE name <> 'checksum' ORDER BY cid",
                                             table));
  std::string columns;
  while (info.Step()) columns += (columns.empty() ? "" : ", ") + info.Text(0);
  return columns;
}

bool HasChecksums(SqliteDatabase& database) {
  return database.QueryInteger(
             "SELECT count(*) FROM pragma_table_info('features') WHERE name = 'checksum'") > 0;
}

// Throws Error when a row is not as it was written. Formats before version 3 cannot tell.
void VerifyRows(SqliteDatabase& database, std::int64_t version) {
  if (version < 3) {
    if (HasChecksums(database)) Fail("it claims to be of format {}, but is newer", version);
    return;
  }
  const auto verify = [&](const MapTable& table) {
    const std::int64_t changed = database.QueryInteger(
        fmt::format("SELECT count(*) FROM {} WHERE checksum IS NOT row_checksum({})", table.name,
                    ColumnsOf(database, table.name)));
    if (changed > 0) {
      Fail("{} of the rows of table {} {} not as written", changed, table.name,
           changed == 1 ? "is" : "are");
    }
  };
  for (const MapTable& table : MapTables(version)) verify(table);
  if (HasTable(database, kImuTable.name)) verify(kImuTable);
  for (const MapTable& table : kPlaceTables) {
    if (HasTable(database, table.name)) verify(table);
  }
}

// Opens `file` and returns what `read` makes of its database and the format's version. Whatever is
// wrong inside becomes one sentence about the file.
template <class Read>
auto ReadChecked(const fs::path& file, Read&& read) {
  OpenMap map;
  Open(map, file);
  try {
    const std::string check = map.database->QueryText("PRAGMA quick_check(1)");
    if (check != "ok") Fail("{}", check);
    auto result = read(*map.database, map.version);
    VerifyRows(*map.database, map.version);
    return result;
  } catch (const SqliteError& error) {
    FailDamaged(file, error.what());
  } catch (const Error& error) {
    FailDamaged(file, error.what());
  }
}

// Feeds one column: a letter for its type, then its bytes; text and BLOBs after their size.
void UpdateDigest(Sha256& sha, const SqliteStatement& row, int column) {
  const auto add = [&sha](const char type, const auto value) {
    sha.Update(&type, 1);
    sha.Update(&value, sizeof(value));
  };
  switch (row.Type(column)) {
    case SQLITE_INTEGER:
      return add('i', row.Integer(column));
    case SQLITE_FLOAT:
      return add('r', row.Real(column));
    case SQLITE_NULL:
      return sha.Update("n");
    default: {
      const auto bytes = row.Blob(column);  // of text, its UTF-8
      add(row.Type(column) == SQLITE_TEXT ? 't' : 'b', std::uint64_t{bytes.size()});
      sha.Update(bytes.data(), bytes.size());
    }
  }
}

}  // namespace

fs::path MapFilePath(const fs::path& file_or_folder) {
  const fs::path inside = file_or_folder / "map.db";
  return fs::exists(inside) ? inside : file_or_folder;
}

Map ReadMap(const fs::path& file) {
  return ReadChecked(file, [](SqliteDatabase& database, std::int64_t version) {
    Map map;
    map.calibration = ReadCalibration(database);
    map.model_pack = ReadMeta(database, "model_pack");
    map.model_pack_sha256 = ReadMeta(database, "model_pack_sha256");
    ReadKeyframes(database, version, map);
    ReadImuReadings(database, map);
    ReadLandmarks(database, map);
    if (version >= 2) ReadLineLandmarks(database, map);
    ForgetRemovedLandmarks(map);
    return map;
  });
}

int ReadMapVersion(const fs::path& file) {
  return ReadChecked(
      file, [](SqliteDatabase&, std::int64_t version) { return static_cast<int>(version); });
}

std::optional<PlaceRecord> ReadPlaceRecord(const fs::path& file) {
  return ReadChecked(file,
                     [](SqliteDatabase& database, std::int64_t) -> std::optional<PlaceRecord> {
                       if (!HasTable(database, "bag_of_words")) return std::nullopt;
                       return ReadPlaceTables(database);
                     });
}

std::string MapDigest(const fs::path& file) {
  return ReadChecked(file, [](SqliteDatabase& database, std::int64_t version) {
    Sha256 sha;
    const auto add = [&](const MapTable& table) {
      sha.Update(table.name);
      SqliteStatement row(database,
                          fmt::format("SELECT * FROM {} ORDER BY {}", table.name, table.key));
      while (row.Step()) {
        const int columns = row.columns() - (version >= 3 ? 1 : 0);  // the last is the checksum
        for (int column = 0; column < columns; ++column) UpdateDigest(sha, row, column);
      }
    };
    for (const MapTable& table : MapTables(version)) add(table);
    if (HasTable(database, kImuTable.name)) add(kImuTable);
    for (const MapTable& table : kPlaceTables) {
      if (HasTable(database, table.name)) add(table);
    }
    return sha.Hex();
  });
}

}  // namespace airslam
