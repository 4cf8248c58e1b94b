// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/map/map_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "airslam/common/error.h"
#include "airslam/map/sqlite.h"
#include "airslam/map/test_map.h"
#include "airslam/sensor/temporary_folder.h"

namespace airslam {
namespace {

using ::testing::HasSubstr;

void ExpectSamePose(const Rigid3& a, const Rigid3& b) {
  EXPECT_EQ(a.rotation.coeffs(), b.rotation.coeffs());
  EXPECT_EQ(a.translation, b.translation);
}

// Everything but the descriptors, bit for bit.
void ExpectSameKeyframe(const Keyframe& a, const Keyframe& b) {
  EXPECT_EQ(a.id, b.id);
  EXPECT_EQ(a.timestamp_ns, b.timestamp_ns);
  EXPECT_EQ(a.component, b.component);
  ExpectSamePose(a.world_from_cam, b.world_from_cam);
  ASSERT_EQ(a.keypoints.size(), b.keypoints.size());
  for (std::size_t i = 0; i < a.keypoints.size(); ++i) {
    EXPECT_EQ(a.keypoints[i].x, b.keypoints[i].x);
    EXPECT_EQ(a.keypoints[i].y, b.keypoints[i].y);
    EXPECT_EQ(a.keypoints[i].score, b.keypoints[i].score);
  }
  EXPECT_EQ(a.right_x, b.right_x);
  EXPECT_EQ(a.landmarks, b.landmarks);
  EXPECT_EQ(a.has_inertial_state, b.has_inertial_state);
  EXPECT_EQ(a.velocity_in_world, b.velocity_in_world);
  EXPECT_EQ(a.gyroscope_bias, b.gyroscope_bias);
  EXPECT_EQ(a.accelerometer_bias, b.accelerometer_bias);
}

class MapFileTest : public testing::Test {
 protected:
  const TemporaryFolder folder_;
  const std::filesystem::path file_ = folder_.path() / "map.db";
};

TEST_F(MapFileTest, RoundTrip) {
  WriteTestMap(file_, 3, 50);
  const Map map = ReadMap(file_);
  const MapCalibration calibration = TestCalibration();
  EXPECT_EQ(map.calibration.stereo.camera.fx, calibration.stereo.camera.fx);
  EXPECT_EQ(map.calibration.stereo.camera.fy, calibration.stereo.camera.fy);
  EXPECT_EQ(map.calibration.stereo.camera.cx, calibration.stereo.camera.cx);
  EXPECT_EQ(map.calibration.stereo.camera.cy, calibration.stereo.camera.cy);
  EXPECT_EQ(map.calibration.stereo.camera.width, 752);
  EXPECT_EQ(map.calibration.stereo.camera.height, 480);
  EXPECT_EQ(map.calibration.stereo.baseline, calibration.stereo.baseline);
  ExpectSamePose(map.calibration.body_from_left, calibration.body_from_left);
  EXPECT_TRUE(map.calibration.has_imu);
  EXPECT_EQ(map.model_pack, "pack");
  EXPECT_EQ(map.model_pack_sha256, "abc123");
  ASSERT_EQ(map.keyframes.size(), 3u);
  for (const auto& [id, keyframe] : map.keyframes) {
    const Keyframe expected = TestKeyframe(id, 50, 1000 * id);
    ExpectSameKeyframe(keyframe, expected);
    EXPECT_LT((keyframe.descriptors - expected.descriptors).cwiseAbs().maxCoeff(), 1.0 / 127);
    for (const Landmark& landmark : TestLandmarks(expected)) {
      EXPECT_EQ(map.landmarks.at(landmark.id).point_in_world, landmark.point_in_world);
      EXPECT_EQ(map.landmarks.at(landmark.id).first_seen_by, id);
    }
  }
  EXPECT_EQ(map.landmarks.size(), 3u * 40u);
}

TEST_F(MapFileTest, LinesJunctionsAndInertialState) {
  Keyframe keyframe = TestKeyframe(0, 4, 0);
  keyframe.component = 2;
  keyframe.lines = {{1, 2, 3, 4, 0.5f}, {5, 6, 7, 8, 0.25f}};
  keyframe.right_lines = {{1, 2, 2, 4, 0.5f}, kNoLine};
  keyframe.line_landmarks = {11, kNoLandmark};
  keyframe.junctions = {{9, 10, 0.75f}};
  keyframe.junction_descriptors = DescriptorMatrix::Constant(1, 4, 0.5f);
  keyframe.has_inertial_state = true;
  keyframe.velocity_in_world = {1, 2, 3};
  keyframe.gyroscope_bias = {0.1, 0.2, 0.3};
  keyframe.accelerometer_bias = {-1, -2, -3};
  const std::vector<LineLandmark> line_landmarks = {{11, {{1, 2, 3}, {4, 5, 7}}, 0}};
  MapWriter writer(file_, TestCalibration(), "pack", "abc");
  writer.AddKeyframe(keyframe, TestLandmarks(keyframe), line_landmarks);
  writer.Close();
  const Map map = ReadMap(file_);
  const Keyframe& read = map.keyframes.at(0);
  ASSERT_EQ(map.line_landmarks.size(), 1u);
  const LineLandmark& line = map.line_landmarks.at(11);
  EXPECT_EQ(line.id, 11);
  EXPECT_EQ(line.ends_in_world.start, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(line.ends_in_world.end, Eigen::Vector3d(4, 5, 7));
  EXPECT_EQ(line.first_seen_by, 0);
  EXPECT_NEAR(line.line_in_world().Distance({4, 5, 7}), 0, 1e-12);
  ExpectSameKeyframe(read, keyframe);
  ASSERT_EQ(read.lines.size(), 2u);
  EXPECT_EQ(read.lines[1].y2, 8);
  EXPECT_EQ(read.line_landmarks, keyframe.line_landmarks);
  ASSERT_EQ(read.right_lines.size(), 2u);
  EXPECT_EQ(read.right_lines[0].x2, 2);
  EXPECT_LT(read.right_lines[1].score, 0);
  ASSERT_EQ(read.junctions.size(), 1u);
  EXPECT_EQ(read.junctions[0].y, 10);
  EXPECT_EQ(read.junction_descriptors, keyframe.junction_descriptors);
}

TEST_F(MapFileTest, KeyframeWithoutKeypoints) {
  WriteTestMap(file_, 1, 0);
  EXPECT_EQ(ReadMap(file_).keyframes.at(0).descriptors.rows(), 0);
}

TEST_F(MapFileTest, ReadableWhileItsWriterIsAtWork) {
  MapWriter writer(file_, TestCalibration(), "pack", "abc");
  EXPECT_TRUE(ReadMap(file_).keyframes.empty());
  const Keyframe keyframe = TestKeyframe(0, 10, 0);
  writer.AddKeyframe(keyframe, TestLandmarks(keyframe));
  EXPECT_EQ(ReadMap(file_).keyframes.size(), 1u);
}

// Someone looks at the map just when the run ends: the log stays, and nothing is lost.
TEST_F(MapFileTest, CloseWhileAReaderIsAtWork) {
  MapWriter writer(file_, TestCalibration(), "pack", "abc");
  SqliteDatabase reader(file_, SqliteDatabase::Mode::kReadOnly);
  reader.Execute("BEGIN");
  EXPECT_EQ(reader.QueryInteger("SELECT count(*) FROM keyframes"), 0);
  const Keyframe keyframe = TestKeyframe(0, 10, 0);
  writer.AddKeyframe(keyframe, TestLandmarks(keyframe));
  writer.Close();
  EXPECT_EQ(ReadMap(file_).keyframes.size(), 1u);
}

TEST_F(MapFileTest, CloseLeavesOneFile) {
  WriteTestMap(file_, 2, 10);
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder_.path()), {}), 1);
}

TEST_F(MapFileTest, UpdateChangesWhatItNames) {
  WriteTestMap(file_, 0, 0);
  std::filesystem::remove(file_);
  MapWriter writer(file_, TestCalibration(), "pack", "abc");
  const Keyframe first = TestKeyframe(0, 10, 0);
  const Keyframe second = TestKeyframe(1, 10, 5);
  writer.AddKeyframe(first, TestLandmarks(first));
  std::vector<Landmark> created = TestLandmarks(second);
  std::erase_if(created, [](const Landmark& landmark) { return landmark.id < 10; });
  writer.AddKeyframe(second, created);

  MapWriter::Update update;
  const Rigid3 moved(Eigen::Quaterniond(0.5, 0.5, 0.5, 0.5), {1, 2, 3});
  update.world_from_cam = {{1, moved}};
  update.landmarks = {{3, {7, 8, 9}, 0}};
  std::vector<LandmarkId> column = first.landmarks;
  column[3] = kNoLandmark;
  update.keyframe_landmarks = {{0, column}};
  update.removed_landmarks = {6};
  update.inertial_states = {{1, {1, 2, 3}, {4, 5, 6}, {7, 8, 9}}};
  writer.Apply(update);
  writer.Close();

  const Map map = ReadMap(file_);
  ExpectSamePose(map.keyframes.at(0).world_from_cam, first.world_from_cam);
  ExpectSamePose(map.keyframes.at(1).world_from_cam, moved);
  EXPECT_EQ(map.landmarks.at(3).point_in_world, Eigen::Vector3d(7, 8, 9));
  EXPECT_EQ(map.landmarks.at(2).point_in_world, TestLandmarks(first)[2].point_in_world);
  EXPECT_FALSE(map.landmarks.contains(6));
  EXPECT_FALSE(map.keyframes.at(0).has_inertial_state);
  EXPECT_TRUE(map.keyframes.at(1).has_inertial_state);
  EXPECT_EQ(map.keyframes.at(1).velocity_in_world, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(map.keyframes.at(1).accelerometer_bias, Eigen::Vector3d(7, 8, 9));
  column[6] = kNoLandmark;  // was removed
  EXPECT_EQ(map.keyframes.at(0).landmarks, column);
  EXPECT_EQ(map.keyframes.at(1).landmarks[1], kNoLandmark);  // the same landmark
  EXPECT_EQ(map.keyframes.at(1).landmarks[2], 7);
}

TEST_F(MapFileTest, LinesMayComeLaterThanTheirKeyframe) {
  const Keyframe bare = TestKeyframe(0, 4, 0);
  Keyframe keyframe = bare;
  keyframe.landmarks[1] = kNoLandmark;  // what has become of it since
  keyframe.lines = {{1, 2, 3, 4, 0.5f}, {5, 6, 7, 8, 0.6f}};
  keyframe.right_lines = {kNoLine, {4, 6, 6, 8, 0.6f}};
  keyframe.line_landmarks = {9, kNoLandmark};
  const std::vector<LineLandmark> landmarks = {{9, {{0, 0, 1}, {0, 0, 2}}, 0}};
  MapWriter writer(file_, TestCalibration(), "pack", "abc");
  writer.AddKeyframe(bare, TestLandmarks(bare));
  const auto error_of = [&](const Keyframe& wrong) {
    return ErrorOf([&] { writer.AddLines(wrong, landmarks); });
  };
  Keyframe unknown = keyframe;
  unknown.id = 7;
  EXPECT_THAT(error_of(unknown), HasSubstr("has no keyframe 7"));
  Keyframe inconsistent = keyframe;
  inconsistent.right_lines.pop_back();
  EXPECT_THAT(error_of(inconsistent), HasSubstr("2 lines but 1 right lines"));
  EXPECT_TRUE(ReadMap(file_).keyframes.at(0).lines.empty());
  writer.AddLines(keyframe, landmarks);
  writer.Close();

  const Map map = ReadMap(file_);
  const Keyframe& read = map.keyframes.at(0);
  ASSERT_EQ(read.lines.size(), 2u);
  EXPECT_EQ(read.lines[1].x2, 7);
  EXPECT_LT(read.right_lines[0].score, 0);
  EXPECT_EQ(read.line_landmarks, keyframe.line_landmarks);
  EXPECT_EQ(read.landmarks, keyframe.landmarks);
  EXPECT_EQ(read.keypoints.size(), bare.keypoints.size());
  EXPECT_EQ(map.line_landmarks.at(9).ends_in_world.end, Eigen::Vector3d(0, 0, 2));
}

TEST_F(MapFileTest, UpdateChangesTheLinesThatItNames) {
  Keyframe keyframe = TestKeyframe(0, 4, 0);
  keyframe.lines.resize(3);
  keyframe.right_lines.resize(3, kNoLine);
  keyframe.line_landmarks = {5, 6, 7};
  std::vector<LineLandmark> lines;
  for (const LandmarkId id : {5, 6, 7}) lines.push_back({id, {{0, 0, 1}, {0, 0, 2}}, 0});
  MapWriter writer(file_, TestCalibration(), "pack", "abc");
  writer.AddKeyframe(keyframe, TestLandmarks(keyframe), lines);
  const std::string before = MapDigest(file_);
  MapWriter::Update update;
  update.line_landmarks = {{5, {{1, 0, 1}, {1, 0, 2}}, 0}};
  update.keyframe_line_landmarks = {{0, {5, kNoLandmark, 7}}};
  update.removed_line_landmarks = {7};
  writer.Apply(update);
  EXPECT_NE(MapDigest(file_), before);

  const auto error_of = [&](const MapWriter::Update& wrong) {
    return ErrorOf([&] { writer.Apply(wrong); });
  };
  EXPECT_THAT(error_of({.line_landmarks = {{7, {{0, 0, 1}, {0, 0, 2}}, 0}}}),
              HasSubstr("has no line landmark 7"));
  EXPECT_THAT(error_of({.line_landmarks = {{5, {{0, 0, 1}, {0, 0, 1}}, 0}}}),
              HasSubstr("not different"));
  EXPECT_THAT(error_of({.keyframe_line_landmarks = {{0, {1, 2}}}}), HasSubstr("as many lines: 0"));
  EXPECT_THAT(error_of({.removed_line_landmarks = {9}}), HasSubstr("has no line landmark 9"));
  writer.Close();

  const Map map = ReadMap(file_);
  EXPECT_EQ(map.keyframes.at(0).line_landmarks,
            (std::vector<LandmarkId>{5, kNoLandmark, kNoLandmark}));
  EXPECT_EQ(map.line_landmarks.size(), 2u);
  EXPECT_EQ(map.line_landmarks.at(5).ends_in_world.end.x(), 1);
}

// Makes a file one of a version without checksums.
void DropChecksums(SqliteDatabase& database, int version) {
  for (const char* table : {"meta", "calibration", "keyframes", "features", "observations",
                            "landmarks", "line_landmarks"}) {
    database.Execute(fmt::format("ALTER TABLE {} DROP COLUMN checksum", table));
  }
  database.Execute(fmt::format("PRAGMA user_version = {}", version));
}

TEST_F(MapFileTest, ReadsVersion2) {
  WriteTestMap(file_, 3, 50);
  const std::string digest = MapDigest(file_);
  {
    SqliteDatabase database(file_, SqliteDatabase::Mode::kCreate);
    DropChecksums(database, 2);
  }
  EXPECT_EQ(ReadMapVersion(file_), 2);
  EXPECT_EQ(MapDigest(file_), digest);  // the content is the same
  EXPECT_EQ(ReadMap(file_).keyframes.size(), 3u);
}

// What version 1 of the format did not have is read as not there.
TEST_F(MapFileTest, ReadsVersion1) {
  Keyframe keyframe = TestKeyframe(0, 4, 0);
  keyframe.lines = {{1, 2, 3, 4, 0.5f}};
  keyframe.right_lines = {{1, 2, 2, 4, 0.5f}};
  keyframe.line_landmarks = {5};
  MapWriter writer(file_, TestCalibration(), "pack", "abc");
  writer.AddKeyframe(keyframe, TestLandmarks(keyframe));
  writer.Close();
  EXPECT_EQ(ReadMapVersion(file_), 3);
  {
    SqliteDatabase database(file_, SqliteDatabase::Mode::kCreate);
    DropChecksums(database, 1);
    database.Execute("DROP TABLE line_landmarks; ALTER TABLE features DROP COLUMN right_lines");
  }
  EXPECT_EQ(ReadMapVersion(file_), 1);
  EXPECT_EQ(MapDigest(file_).size(), 64u);
  const Map map = ReadMap(file_);
  EXPECT_TRUE(map.line_landmarks.empty());
  const Keyframe& read = map.keyframes.at(0);
  ExpectSameKeyframe(read, keyframe);
  ASSERT_EQ(read.right_lines.size(), 1u);
  EXPECT_LT(read.right_lines[0].score, 0);
  EXPECT_EQ(read.line_landmarks, std::vector<LandmarkId>{kNoLandmark});
}

// Each is refused, and leaves the map as it was.
TEST_F(MapFileTest, InconsistentInputIsRefusedAsAWhole) {
  MapWriter writer(file_, TestCalibration(), "pack", "abc");
  const Keyframe keyframe = TestKeyframe(0, 10, 0);
  writer.AddKeyframe(keyframe, TestLandmarks(keyframe));
  const std::string before = MapDigest(file_);
  const double nan = std::numeric_limits<double>::quiet_NaN();

  const auto error_of_update = [&](const MapWriter::Update& update) {
    return ErrorOf([&] { writer.Apply(update); });
  };
  EXPECT_THAT(error_of_update({.world_from_cam = {{0, Rigid3()}, {7, Rigid3()}}}),
              HasSubstr("has no keyframe 7"));
  EXPECT_THAT(error_of_update({.world_from_cam = {{0, Rigid3({1, 0, 0, 0}, {nan, 0, 0})}}}),
              HasSubstr("not finite"));
  EXPECT_THAT(error_of_update({.landmarks = {{0, {1, 1, 1}, 0}, {99, {1, 1, 1}, 0}}}),
              HasSubstr("has no landmark 99"));
  EXPECT_THAT(error_of_update({.landmarks = {{0, {nan, 1, 1}, 0}}}), HasSubstr("not finite"));
  EXPECT_THAT(error_of_update({.landmarks = {{0, {1, 1, 1}, 5}}}), HasSubstr("FOREIGN KEY"));
  EXPECT_THAT(error_of_update({.keyframe_landmarks = {{0, {1, 2, 3}}}}),
              HasSubstr("as many keypoints: 0"));
  EXPECT_THAT(error_of_update({.inertial_states = {{0, {nan, 0, 0}, {0, 0, 0}, {0, 0, 0}}}}),
              HasSubstr("not finite"));
  EXPECT_THAT(error_of_update({.removed_landmarks = {0, 99}}), HasSubstr("has no landmark 99"));

  EXPECT_THAT(ErrorOf([&] { writer.AddKeyframe(keyframe, {}); }), HasSubstr("UNIQUE"));
  Keyframe bad = TestKeyframe(1, 10, 0);
  bad.right_x.pop_back();
  EXPECT_THAT(ErrorOf([&] { writer.AddKeyframe(bad, {}); }), HasSubstr("9 right columns"));
  bad = TestKeyframe(1, 10, 0);
  bad.lines.resize(1);
  EXPECT_THAT(ErrorOf([&] { writer.AddKeyframe(bad, {}); }), HasSubstr("1 lines but 0"));
  bad = TestKeyframe(1, 10, 0);
  bad.junctions.resize(1);
  EXPECT_THAT(ErrorOf([&] { writer.AddKeyframe(bad, {}); }), HasSubstr("1 junctions but 0"));
  bad = TestKeyframe(1, 10, 0);
  bad.descriptors(2, 2) = std::numeric_limits<float>::infinity();
  EXPECT_THAT(ErrorOf([&] { writer.AddKeyframe(bad, {}); }), HasSubstr("not finite"));
  const std::vector<Landmark> known = TestLandmarks(keyframe);
  EXPECT_THAT(ErrorOf([&] { writer.AddKeyframe(TestKeyframe(1, 10, 0), known); }),
              HasSubstr("UNIQUE"));

  EXPECT_EQ(MapDigest(file_), before);
  const Keyframe next = TestKeyframe(1, 10, 100);
  writer.AddKeyframe(next, TestLandmarks(next));  // the writer is still of use
  EXPECT_EQ(ReadMap(file_).keyframes.size(), 2u);
}

TEST_F(MapFileTest, WriterRefusesAnExistingFileAndAMissingFolder) {
  WriteTestMap(file_, 1, 5);
  EXPECT_THAT(ErrorOf([&] { MapWriter(file_, TestCalibration(), "pack", "abc"); }),
              HasSubstr("exists already"));
  EXPECT_THAT(ErrorOf([&] { MapWriter("/nonexistent/map.db", TestCalibration(), "pack", "abc"); }),
              HasSubstr("cannot create map file /nonexistent/map.db"));
}

TEST_F(MapFileTest, ClosedWriterRefuses) {
  MapWriter writer(file_, TestCalibration(), "pack", "abc");
  writer.Close();
  writer.Close();
  EXPECT_THAT(ErrorOf([&] { writer.AddKeyframe(TestKeyframe(0, 1, 0), {}); }),
              HasSubstr("is closed"));
}

TEST_F(MapFileTest, DigestIsOfTheContentNotOfTheFile) {
  WriteTestMap(file_, 3, 20);
  const std::filesystem::path other = folder_.path() / "other.db";
  MapWriter writer(other, TestCalibration(), "pack", "abc123");
  for (KeyframeId id = 0; id < 3; ++id) {
    const Keyframe keyframe = TestKeyframe(id, 20, 1000 * id);
    std::vector<Landmark> landmarks = TestLandmarks(keyframe);
    std::reverse(landmarks.begin(), landmarks.end());
    writer.AddKeyframe(keyframe, landmarks);
  }
  // The detour leaves other pages, but the same rows.
  Landmark landmark = TestLandmarks(TestKeyframe(0, 20, 0))[1];
  const Eigen::Vector3d point = landmark.point_in_world;
  landmark.point_in_world.setZero();
  writer.Apply({.landmarks = {landmark}});
  EXPECT_NE(MapDigest(other), MapDigest(file_));
  landmark.point_in_world = point;
  writer.Apply({.landmarks = {landmark}});
  EXPECT_EQ(MapDigest(other), MapDigest(file_));  // log and all
  writer.Close();
  EXPECT_EQ(MapDigest(other), MapDigest(file_));
  EXPECT_EQ(MapDigest(file_).size(), 64u);
}

TEST_F(MapFileTest, DigestSeesEveryTable) {
  const auto digest_of = [&](const char* name, const MapCalibration& calibration,
                             const std::string& pack, const Keyframe& keyframe,
                             const std::vector<Landmark>& landmarks) {
    const std::filesystem::path file = folder_.path() / name;
    MapWriter writer(file, calibration, pack, "abc");
    writer.AddKeyframe(keyframe, landmarks);
    writer.Close();
    return MapDigest(file);
  };
  const MapCalibration calibration = TestCalibration();
  const Keyframe keyframe = TestKeyframe(0, 10, 0);
  const std::vector<Landmark> landmarks = TestLandmarks(keyframe);
  const std::string original = digest_of("a", calibration, "pack", keyframe, landmarks);
  EXPECT_EQ(digest_of("b", calibration, "pack", keyframe, landmarks), original);

  MapCalibration wider = calibration;
  wider.stereo.baseline = std::nextafter(wider.stereo.baseline, 1.0);
  EXPECT_NE(digest_of("c", wider, "pack", keyframe, landmarks), original);
  EXPECT_NE(digest_of("d", calibration, "pack2", keyframe, landmarks), original);
  Keyframe changed = keyframe;
  changed.world_from_cam.translation.x() += 1e-12;
  EXPECT_NE(digest_of("e", calibration, "pack", changed, landmarks), original);
  changed = keyframe;
  changed.keypoints[4].score += 1e-6f;
  EXPECT_NE(digest_of("f", calibration, "pack", changed, landmarks), original);
  changed = keyframe;
  changed.landmarks[4] = 3;
  EXPECT_NE(digest_of("g", calibration, "pack", changed, landmarks), original);
  std::vector<Landmark> fewer = landmarks;
  fewer.pop_back();
  EXPECT_NE(digest_of("h", calibration, "pack", keyframe, fewer), original);
}

TEST(MapFile, KeepsReadingsOfTheImu) {
  const TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "map.db";
  Keyframe keyframe = TestKeyframe(0, 5, 0);
  {
    MapWriter writer(file, TestCalibration(), "pack", "abc123");
    writer.AddKeyframe(keyframe, TestLandmarks(keyframe));
    writer.Close();
  }
  EXPECT_TRUE(ReadMap(file).keyframes.at(0).imu_samples.empty());
  const std::string without = MapDigest(file);
  std::filesystem::remove(file);
  keyframe.imu_noise = {1e-4, 2e-5, 3e-3, 4e-4, 200};
  keyframe.imu_samples = {{100, {0.5, 0, 0.25}, {0, 0, 9.5}}, {200, {0.5, 1, 0.25}, {0, 2, 9.5}}};
  MapWriter writer(file, TestCalibration(), "pack", "abc123");
  writer.AddKeyframe(keyframe, TestLandmarks(keyframe));
  EXPECT_EQ(ReadMap(file).keyframes.at(0).imu_samples.size(), 2u);
  EXPECT_NE(MapDigest(file), without);
  keyframe.imu_samples[1].acceleration.x() = 4;
  writer.Apply({.imu_readings = {{0, keyframe.imu_samples, keyframe.imu_noise}}});
  writer.Close();
  const Keyframe read = ReadMap(file).keyframes.at(0);
  EXPECT_EQ(read.imu_noise.accelerometer_noise_density, 3e-3);
  EXPECT_EQ(read.imu_noise.rate_hz, 200);
  EXPECT_EQ(read.imu_samples[1].timestamp_ns, 200);
  EXPECT_EQ(read.imu_samples[1].acceleration, Eigen::Vector3d(4, 2, 9.5));
}

}  // namespace
}  // namespace airslam
