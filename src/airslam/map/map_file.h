// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "airslam/map/map.h"
#include "airslam/map/place_record.h"

namespace airslam {

// The version of the schema that this program writes, and the newest that it reads. It reads all
// earlier ones: version 1 has no line landmarks and no right lines, versions 1 and 2 no checksums.
inline constexpr int kMapFormatVersion = 3;

// Writes a map file (SQLite 3, WAL; schema in docs/map_format.md). Every call below is one
// transaction: a killed process leaves all that was committed. Not thread-safe: one thread owns it.
// Every call throws Error, leaving the file as before the call, when its input is inconsistent (an
// unknown id, arrays of different lengths, a number that is not finite) or the disk is full.
class MapWriter {
 public:
  // Creates `file`; an existing file is an Error. `calibration` and the pack's name and hash are
  // those of the map.
  MapWriter(const std::filesystem::path& file, const MapCalibration& calibration,
            const std::string& model_pack, const std::string& model_pack_sha256);
  ~MapWriter();
  MapWriter(const MapWriter&) = delete;
  MapWriter& operator=(const MapWriter&) = delete;

  // Commits a new keyframe together with the landmarks that it created.
  void AddKeyframe(const Keyframe& keyframe, std::span<const Landmark> new_landmarks,
                   std::span<const LineLandmark> new_line_landmarks = {});

  // Commits the lines, junctions and line landmark ids of a keyframe that was added without them,
  // together with the line landmarks that they created. The rest of the keyframe's features must be
  // what was added, or has become of it since.
  void AddLines(const Keyframe& keyframe, std::span<const LineLandmark> new_line_landmarks);

  // Commits what local bundle adjustment changed: poses and inertial states of keyframes, places of
  // landmarks, observations and landmarks that were removed as outliers. All parts belong to
  // known ids. Keyframes that still name a removed landmark are read back as not seeing it.
  struct Update {
    std::vector<std::pair<KeyframeId, Rigid3>> world_from_cam = {};
    std::vector<Landmark> landmarks = {};
    // Keyframes whose keypoints' landmark ids changed: the whole new column.
    std::vector<std::pair<KeyframeId, std::vector<LandmarkId>>> keyframe_landmarks = {};
    std::vector<LandmarkId> removed_landmarks = {};
    // Velocity of the body in world (m/s) and biases (rad/s, m/s^2).
    struct InertialState {
      KeyframeId keyframe = -1;
      Eigen::Vector3d velocity_in_world, gyroscope_bias, accelerometer_bias;
    };
    std::vector<InertialState> inertial_states = {};
    // The same of lines.
    std::vector<LineLandmark> line_landmarks = {};
    std::vector<std::pair<KeyframeId, std::vector<LandmarkId>>> keyframe_line_landmarks = {};
    std::vector<LandmarkId> removed_line_landmarks = {};
    // Readings of the IMU before a keyframe, in place of those that it has.
    struct ImuReadings {
      KeyframeId keyframe = -1;
      std::vector<ImuSample> samples;
      ImuNoise noise;
    };
    std::vector<ImuReadings> imu_readings = {};
  };
  void Apply(const Update& update);

  // Commits what place recognition keeps, in place of an earlier record.
  void WritePlaceRecord(const PlaceRecord& record);

  // Folds the write-ahead log into the file and closes it.
  void Close();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// The map file that a user means: the file, or map.db of the folder that a run wrote.
std::filesystem::path MapFilePath(const std::filesystem::path& file_or_folder);

// Reads a whole map, also one whose writer was killed or is still at work, and also from a folder
// that cannot be written. Throws Error with one sentence when the file does not exist, is not a
// map, is truncated or damaged, or was written by a newer version. Descriptors are as precise as
// RestoreDescriptors says; all else is as written, bit for bit.
Map ReadMap(const std::filesystem::path& file);

// The version of the format of a file that ReadMap reads.
int ReadMapVersion(const std::filesystem::path& file);

// The place record of a map; nothing when none was written. Throws Error as ReadMap does.
std::optional<PlaceRecord> ReadPlaceRecord(const std::filesystem::path& file);

// SHA-256 over the content (table rows in order of their keys), not over SQLite's bytes: equal for
// two runs that made the same map.
std::string MapDigest(const std::filesystem::path& file);

}  // namespace airslam
