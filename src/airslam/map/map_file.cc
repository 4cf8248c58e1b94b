// SPDX-License-Identifier: BSD-3-Clause
//
// The writing half; map_reader.cc reads.
#include "airslam/map/map_file.h"

#include <sqlite3.h>

#include <array>
#include <optional>

#include "airslam/common/error.h"
#include "airslam/common/sha256.h"
#include "airslam/map/map_codec.h"
#include "airslam/map/map_schema.h"
#include "airslam/map/sqlite.h"

namespace airslam {
namespace {

void RequireFinite(const Rigid3& pose, const std::string& what) {
  if (!pose.rotation.coeffs().allFinite() || !pose.translation.allFinite()) {
    Fail("{} has a pose that is not finite", what);
  }
}

void RequireConsistent(const Keyframe& keyframe) {
  const std::size_t n = keyframe.keypoints.size();
  if (static_cast<std::size_t>(keyframe.descriptors.rows()) != n || keyframe.right_x.size() != n ||
      keyframe.landmarks.size() != n) {
    Fail("keyframe {} has {} keypoints but {} descriptors, {} right columns, {} landmark ids",
         keyframe.id, n, keyframe.descriptors.rows(), keyframe.right_x.size(),
         keyframe.landmarks.size());
  }
  if (keyframe.line_landmarks.size() != keyframe.lines.size() ||
      keyframe.right_lines.size() != keyframe.lines.size()) {
    Fail("keyframe {} has {} lines but {} right lines, {} line landmark ids", keyframe.id,
         keyframe.lines.size(), keyframe.right_lines.size(), keyframe.line_landmarks.size());
  }
  if (static_cast<std::size_t>(keyframe.junction_descriptors.rows()) != keyframe.junctions.size()) {
    Fail("keyframe {} has {} junctions but {} junction descriptors", keyframe.id,
         keyframe.junctions.size(), keyframe.junction_descriptors.rows());
  }
  RequireFinite(keyframe.world_from_cam, fmt::format("keyframe {}", keyframe.id));
}

// "INSERT INTO table VALUES (?1, ..., row_checksum(?1, ...))": a row and its checksum.
std::string InsertSql(std::string_view table, int columns, std::string_view verb = "INSERT") {
  std::string parameters;
  for (int i = 1; i <= columns; ++i) parameters += fmt::format("{}?{}", i > 1 ? ", " : "", i);
  return fmt::format("{} INTO {} VALUES ({}, row_checksum({}))", verb, table, parameters,
                     parameters);
}

// Binds qw, qx, qy, qz, tx, ty, tz from `parameter` on.
void BindPose(SqliteStatement& statement, int parameter, const Rigid3& pose) {
  const Eigen::Quaterniond& q = pose.rotation;
  for (const double value : {q.w(), q.x(), q.y(), q.z(), pose.translation.x(), pose.translation.y(),
                             pose.translation.z()}) {
    statement.Bind(parameter++, value);
  }
}

// Binds id, x, y, z, first_seen_by.
void BindLandmark(SqliteStatement& statement, const Landmark& landmark) {
  if (!landmark.point_in_world.allFinite()) {
    Fail("landmark {} has a position that is not finite", landmark.id);
  }
  statement.Bind(1, landmark.id);
  statement.Bind(2, landmark.point_in_world.x());
  statement.Bind(3, landmark.point_in_world.y());
  statement.Bind(4, landmark.point_in_world.z());
  statement.Bind(5, std::int64_t{landmark.first_seen_by});
}

// Binds id, x1, y1, z1, x2, y2, z2, first_seen_by.
void BindLineLandmark(SqliteStatement& statement, const LineLandmark& landmark) {
  const SpaceSegment& ends = landmark.ends_in_world;
  if (!ends.start.allFinite() || !ends.end.allFinite() || ends.start == ends.end) {
    Fail("line landmark {} has ends that are not finite or not different", landmark.id);
  }
  int parameter = 1;
  statement.Bind(parameter++, landmark.id);
  for (const Eigen::Vector3d& end : {ends.start, ends.end}) {
    for (const double value : end) statement.Bind(parameter++, value);
  }
  statement.Bind(parameter, std::int64_t{landmark.first_seen_by});
}

Bytes EncodeInertialState(const MapWriter::Update::InertialState& state) {
  std::vector<double> values;
  for (const Eigen::Vector3d& v :
       {state.velocity_in_world, state.gyroscope_bias, state.accelerometer_bias}) {
    if (!v.allFinite()) {
      Fail("keyframe {} has a velocity or a bias that is not finite", state.keyframe);
    }
    values.insert(values.end(), v.data(), v.data() + 3);
  }
  return EncodeArray<double>(values);
}

}  // namespace

struct MapWriter::Impl {
  explicit Impl(const std::filesystem::path& path) : file(path) {}

  // Runs `work` as one transaction; what SQLite answers becomes an Error that names the file.
  template <class Work>
  void Transact(Work&& work) {
    if (!database) Fail("map file {} is closed", file.string());
    try {
      SqliteTransaction transaction(*database);
      work();
      transaction.Commit();
    } catch (const SqliteError& error) {
      Fail("cannot write map file {}: {}", file.string(), error.what());
    }
  }

  void Create(const MapCalibration& calibration, const std::string& model_pack,
              const std::string& model_pack_sha256);
  void WriteCalibration(const MapCalibration& calibration);
  void InsertFeatures(const Keyframe& keyframe);
  void InsertObservations(const Keyframe& keyframe);
  void InsertLineLandmarks(std::span<const LineLandmark> landmarks);
  void RequireKeyframe(KeyframeId id);
  void WriteImuReadings(KeyframeId id, const std::vector<ImuSample>& samples,
                        const ImuNoise& noise);
  // The parts of an update, within its transaction.
  void UpdateKeyframes(const Update& update);
  void UpdatePoints(const Update& update);
  void UpdateLines(const Update& update);
  // Runs a statement that must change the one row of `id`.
  void RunOn(SqliteStatement& statement, const char* what, std::int64_t id);

  std::filesystem::path file;
  std::optional<SqliteDatabase> database;
  struct Statements {
    explicit Statements(SqliteDatabase& db)
        : insert_keyframe(db, InsertSql("keyframes", 11)),
          // In place of a keyframe's rows without lines; keyframes themselves are not replaced.
          insert_features(db, InsertSql("features", 10, "INSERT OR REPLACE")),
          insert_observations(db, InsertSql("observations", 3, "INSERT OR REPLACE")),
          find_keyframe(db, "SELECT 1 FROM keyframes WHERE id=?1"),
          insert_landmark(db, InsertSql("landmarks", 5)),
          update_pose(db,
                      "UPDATE keyframes SET qw=?2, qx=?3, qy=?4, qz=?5, tx=?6, ty=?7, tz=?8, "
                      "checksum=row_checksum(id, timestamp_ns, component, ?2, ?3, ?4, ?5, ?6, ?7, "
                      "?8, inertial_state) WHERE id=?1"),
          update_inertial_state(db,
                                "UPDATE keyframes SET inertial_state=?2, checksum=row_checksum(id, "
                                "timestamp_ns, component, qw, qx, qy, qz, tx, ty, tz, ?2) "
                                "WHERE id=?1"),
          update_landmark(db,
                          "UPDATE landmarks SET x=?2, y=?3, z=?4, first_seen_by=?5, "
                          "checksum=row_checksum(?1, ?2, ?3, ?4, ?5) WHERE id=?1"),
          update_observations(db,
                              "UPDATE observations SET landmarks=?2, "
                              "checksum=row_checksum(keyframe_id, ?2, line_landmarks) "
                              "WHERE keyframe_id=?1 AND length(landmarks) = length(?2)"),
          delete_landmark(db, "DELETE FROM landmarks WHERE id=?1"),
          insert_line_landmark(db, InsertSql("line_landmarks", 8)),
          update_line_landmark(db,
                               "UPDATE line_landmarks SET x1=?2, y1=?3, z1=?4, x2=?5, y2=?6, "
                               "z2=?7, first_seen_by=?8, checksum=row_checksum(?1, ?2, ?3, ?4, ?5, "
                               "?6, ?7, ?8) WHERE id=?1"),
          update_line_observations(db,
                                   "UPDATE observations SET line_landmarks=?2, "
                                   "checksum=row_checksum(keyframe_id, landmarks, ?2) WHERE "
                                   "keyframe_id=?1 AND length(line_landmarks) = length(?2)"),
          delete_line_landmark(db, "DELETE FROM line_landmarks WHERE id=?1") {}
    SqliteStatement insert_keyframe, insert_features, insert_observations, find_keyframe;
    SqliteStatement insert_landmark;
    SqliteStatement update_pose, update_inertial_state;
    SqliteStatement update_landmark, update_observations, delete_landmark;
    SqliteStatement insert_line_landmark, update_line_landmark, update_line_observations;
    SqliteStatement delete_line_landmark;
  };
  std::optional<Statements> sql;  // after `database`: finalized before it is closed
};

void MapWriter::Impl::Create(const MapCalibration& calibration, const std::string& model_pack,
                             const std::string& model_pack_sha256) {
  RequireFinite(calibration.body_from_left, "the calibration");
  if (std::error_code ignored; std::filesystem::exists(file, ignored)) {
    Fail("map file {} exists already", file.string());
  }
  try {
    database.emplace(file, SqliteDatabase::Mode::kCreate);
    database->Execute("PRAGMA foreign_keys = ON");
    database->Execute("PRAGMA synchronous = NORMAL");
    {
      // Before WAL: the file itself, without its log, is a map from the first moment on.
      SqliteTransaction transaction(*database);
      database->Execute(fmt::format("PRAGMA application_id = {}", kMapApplicationId));
      database->Execute(fmt::format("PRAGMA user_version = {}", kMapFormatVersion));
      database->Execute(kMapSchema);
      WriteCalibration(calibration);
      SqliteStatement meta(*database, InsertSql("meta", 2));
      for (const auto& [key, value] :
           {std::pair<std::string_view, std::string_view>{"model_pack", model_pack},
            {"model_pack_sha256", model_pack_sha256}}) {
        meta.Bind(1, key);
        meta.Bind(2, value);
        meta.Run();
      }
      transaction.Commit();
    }
    database->QueryText("PRAGMA journal_mode = WAL");
    sql.emplace(*database);
  } catch (const SqliteError& error) {
    Fail("cannot create map file {}: {}", file.string(), error.what());
  }
}

void MapWriter::Impl::WriteCalibration(const MapCalibration& calibration) {
  SqliteStatement statement(*database, InsertSql("calibration", 16));
  const Pinhole& camera = calibration.stereo.camera;
  statement.Bind(1, std::int64_t{1});
  statement.Bind(2, camera.fx);
  statement.Bind(3, camera.fy);
  statement.Bind(4, camera.cx);
  statement.Bind(5, camera.cy);
  statement.Bind(6, std::int64_t{camera.width});
  statement.Bind(7, std::int64_t{camera.height});
  statement.Bind(8, calibration.stereo.baseline);
  BindPose(statement, 9, calibration.body_from_left);
  statement.Bind(16, std::int64_t{calibration.has_imu});
  statement.Run();
}

void MapWriter::Impl::InsertFeatures(const Keyframe& keyframe) {
  SqliteStatement& insert = sql->insert_features;
  const Bytes keypoints = EncodeKeypoints(keyframe.keypoints);
  const Bytes right_x = EncodeArray<float>(keyframe.right_x);
  const QuantizedDescriptors descriptors = QuantizeDescriptors(keyframe.descriptors);
  const Bytes lines = EncodeLines(keyframe.lines);
  const Bytes right_lines = EncodeLines(keyframe.right_lines);
  const Bytes junctions = EncodeKeypoints(keyframe.junctions);
  const QuantizedDescriptors junction_descriptors =
      QuantizeDescriptors(keyframe.junction_descriptors);
  insert.Bind(1, std::int64_t{keyframe.id});
  insert.Bind(2, keypoints);
  insert.Bind(3, right_x);
  insert.Bind(4, descriptors.scale);
  insert.Bind(5, descriptors.values);
  if (!lines.empty()) {  // what is not bound is NULL
    insert.Bind(6, lines);
    insert.Bind(10, right_lines);
  }
  if (!junctions.empty()) {
    insert.Bind(7, junctions);
    insert.Bind(8, junction_descriptors.scale);
    insert.Bind(9, junction_descriptors.values);
  }
  insert.Run();
}

void MapWriter::Impl::InsertObservations(const Keyframe& keyframe) {
  SqliteStatement& insert = sql->insert_observations;
  const Bytes landmarks = EncodeArray<LandmarkId>(keyframe.landmarks);
  const Bytes line_landmarks = EncodeArray<LandmarkId>(keyframe.line_landmarks);
  insert.Bind(1, std::int64_t{keyframe.id});
  insert.Bind(2, landmarks);
  if (!line_landmarks.empty()) insert.Bind(3, line_landmarks);
  insert.Run();
}

void MapWriter::Impl::InsertLineLandmarks(std::span<const LineLandmark> landmarks) {
  for (const LineLandmark& landmark : landmarks) {
    BindLineLandmark(sql->insert_line_landmark, landmark);
    sql->insert_line_landmark.Run();
  }
}

void MapWriter::Impl::RequireKeyframe(KeyframeId id) {
  sql->find_keyframe.Bind(1, std::int64_t{id});
  const bool found = sql->find_keyframe.Step();
  sql->find_keyframe.Reset();
  if (!found) Fail("map file {} has no keyframe {}", file.string(), id);
}

void MapWriter::Impl::WriteImuReadings(KeyframeId id, const std::vector<ImuSample>& samples,
                                       const ImuNoise& noise) {
  if (samples.empty()) return;
  database->Execute(kImuSchema);
  SqliteStatement write(*database, InsertSql("imu_readings", 3, "INSERT OR REPLACE"));
  const Bytes noise_values = EncodeArray<double>(std::array<double, 5>{
      noise.gyroscope_noise_density, noise.gyroscope_random_walk, noise.accelerometer_noise_density,
      noise.accelerometer_random_walk, noise.rate_hz});
  const Bytes blob = EncodeImuSamples(samples);
  write.Bind(1, std::int64_t{id});
  write.Bind(2, noise_values);
  write.Bind(3, blob);
  write.Run();
}

void MapWriter::Impl::RunOn(SqliteStatement& statement, const char* what, std::int64_t id) {
  statement.Run();
  if (database->Changes() != 1) Fail("map file {} has no {} {}", file.string(), what, id);
}

void MapWriter::Impl::UpdateKeyframes(const Update& update) {
  for (const auto& [id, pose] : update.world_from_cam) {
    RequireFinite(pose, fmt::format("keyframe {}", id));
    sql->update_pose.Bind(1, std::int64_t{id});
    BindPose(sql->update_pose, 2, pose);
    RunOn(sql->update_pose, "keyframe", id);
  }
  for (const Update::InertialState& state : update.inertial_states) {
    const Bytes blob = EncodeInertialState(state);
    sql->update_inertial_state.Bind(1, std::int64_t{state.keyframe});
    sql->update_inertial_state.Bind(2, blob);
    RunOn(sql->update_inertial_state, "keyframe", state.keyframe);
  }
}

void MapWriter::Impl::UpdatePoints(const Update& update) {
  for (const Landmark& landmark : update.landmarks) {
    BindLandmark(sql->update_landmark, landmark);
    RunOn(sql->update_landmark, "landmark", landmark.id);
  }
  for (const auto& [id, landmarks] : update.keyframe_landmarks) {
    const Bytes blob = EncodeArray<LandmarkId>(landmarks);
    sql->update_observations.Bind(1, std::int64_t{id});
    sql->update_observations.Bind(2, blob);
    RunOn(sql->update_observations, "keyframe with as many keypoints:", id);
  }
  for (const LandmarkId id : update.removed_landmarks) {
    sql->delete_landmark.Bind(1, id);
    RunOn(sql->delete_landmark, "landmark", id);
  }
}

void MapWriter::Impl::UpdateLines(const Update& update) {
  for (const LineLandmark& landmark : update.line_landmarks) {
    BindLineLandmark(sql->update_line_landmark, landmark);
    RunOn(sql->update_line_landmark, "line landmark", landmark.id);
  }
  for (const auto& [id, landmarks] : update.keyframe_line_landmarks) {
    const Bytes blob = EncodeArray<LandmarkId>(landmarks);
    sql->update_line_observations.Bind(1, std::int64_t{id});
    sql->update_line_observations.Bind(2, blob);
    RunOn(sql->update_line_observations, "keyframe with as many lines:", id);
  }
  for (const LandmarkId id : update.removed_line_landmarks) {
    sql->delete_line_landmark.Bind(1, id);
    RunOn(sql->delete_line_landmark, "line landmark", id);
  }
}

MapWriter::MapWriter(const std::filesystem::path& file, const MapCalibration& calibration,
                     const std::string& model_pack, const std::string& model_pack_sha256)
    : impl_(std::make_unique<Impl>(file)) {
  impl_->Create(calibration, model_pack, model_pack_sha256);
}

MapWriter::~MapWriter() = default;

void MapWriter::AddKeyframe(const Keyframe& keyframe, std::span<const Landmark> new_landmarks,
                            std::span<const LineLandmark> new_line_landmarks) {
  RequireConsistent(keyframe);
  impl_->Transact([&] {
    SqliteStatement& insert = impl_->sql->insert_keyframe;
    const Bytes inertial_state =
        EncodeInertialState({keyframe.id, keyframe.velocity_in_world, keyframe.gyroscope_bias,
                             keyframe.accelerometer_bias});
    insert.Bind(1, std::int64_t{keyframe.id});
    insert.Bind(2, keyframe.timestamp_ns);
    insert.Bind(3, std::int64_t{keyframe.component});
    BindPose(insert, 4, keyframe.world_from_cam);
    if (keyframe.has_inertial_state) insert.Bind(11, inertial_state);
    insert.Run();
    impl_->InsertFeatures(keyframe);
    impl_->InsertObservations(keyframe);
    impl_->WriteImuReadings(keyframe.id, keyframe.imu_samples, keyframe.imu_noise);
    for (const Landmark& landmark : new_landmarks) {
      BindLandmark(impl_->sql->insert_landmark, landmark);
      impl_->sql->insert_landmark.Run();
    }
    impl_->InsertLineLandmarks(new_line_landmarks);
  });
}

void MapWriter::AddLines(const Keyframe& keyframe,
                         std::span<const LineLandmark> new_line_landmarks) {
  RequireConsistent(keyframe);
  impl_->Transact([&] {
    impl_->RequireKeyframe(keyframe.id);
    impl_->InsertFeatures(keyframe);
    impl_->InsertObservations(keyframe);
    impl_->InsertLineLandmarks(new_line_landmarks);
  });
}

void MapWriter::Apply(const Update& update) {
  impl_->Transact([&] {
    impl_->UpdateKeyframes(update);
    impl_->UpdatePoints(update);
    impl_->UpdateLines(update);
    for (const Update::ImuReadings& readings : update.imu_readings) {
      impl_->WriteImuReadings(readings.keyframe, readings.samples, readings.noise);
    }
  });
}

void MapWriter::WritePlaceRecord(const PlaceRecord& record) {
  impl_->Transact([&] {
    impl_->database->Execute(kPlaceSchema);
    SqliteStatement vocabulary(*impl_->database, InsertSql("vocabulary", 3));
    vocabulary.Bind(1, std::string_view("keypoints"));
    vocabulary.Bind(2, std::string_view(record.vocabulary_sha256));
    vocabulary.Run();
    if (!record.junction_vocabulary.empty()) {
      Sha256 sha;
      sha.Update(record.junction_vocabulary.data(), record.junction_vocabulary.size());
      const std::string digest = sha.Hex();
      vocabulary.Bind(1, std::string_view("junctions"));
      vocabulary.Bind(2, std::string_view(digest));
      vocabulary.Bind(3, record.junction_vocabulary);
      vocabulary.Run();
    }
    SqliteStatement words(*impl_->database, InsertSql("bag_of_words", 3));
    for (const auto& [id, of_keyframe] : record.words) {
      const Bytes keypoints = EncodeArray<std::uint16_t>(of_keyframe.keypoints);
      const Bytes junctions = EncodeArray<std::uint16_t>(of_keyframe.junctions);
      words.Bind(1, std::int64_t{id});
      words.Bind(2, keypoints);
      if (!junctions.empty()) words.Bind(3, junctions);
      words.Run();
    }
    SqliteStatement shared(*impl_->database, InsertSql("covisibility", 3));
    for (const auto& [a, neighbours] : record.covisibility) {
      for (const auto& [b, count] : neighbours) {
        if (b <= a) continue;
        shared.Bind(1, std::int64_t{a});
        shared.Bind(2, std::int64_t{b});
        shared.Bind(3, std::int64_t{count});
        shared.Run();
      }
    }
  });
}

void MapWriter::Close() {
  if (!impl_->database) return;
  impl_->sql.reset();
  try {
    // Leaving WAL makes the file complete in itself, so that it opens in folders that cannot be
    // written. While a reader is at work that is not to be had: the log stays beside the file.
    impl_->database->Execute("PRAGMA busy_timeout = 1000");
    impl_->database->QueryText("PRAGMA journal_mode = DELETE");
  } catch (const SqliteError& error) {
    if (error.result_code() != SQLITE_BUSY)
      Fail("cannot close map file {}: {}", impl_->file.string(), error.what());
  }
  impl_->database.reset();
}

}  // namespace airslam
