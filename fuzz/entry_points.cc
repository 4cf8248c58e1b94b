// SPDX-License-Identifier: BSD-3-Clause
#include "entry_points.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <string>

#include "airslam/common/error.h"
#include "airslam/common/options.h"
#include "airslam/dataset/picture_formats.h"
#include "airslam/dataset/recorded_sequence.h"
#include "airslam/dataset/trajectory.h"
#include "airslam/map/map_file.h"
#include "airslam/map/map_summary.h"
#include "airslam/neural/model_pack.h"
#include "airslam/place/vocabulary.h"
#include "airslam/sensor/calibration.h"
#include "airslam/sensor/rectification.h"
#include "airslam/sensor/temporary_folder.h"

namespace airslam {
namespace {

namespace fs = std::filesystem;
using Bytes = std::span<const std::uint8_t>;

constexpr char kCamera[] = R"(T_BS: {data: [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]}
resolution: [8, 6]
intrinsics: [9, 9, 4, 3]
distortion_model: radial-tangential
distortion_coefficients: [-0.2, 0.05, 0.001, 0.0001]
)";
constexpr char kRightCamera[] = R"(T_BS: {data: [1,0,0,0.1, 0,1,0,0, 0,0,1,0, 0,0,0,1]}
resolution: [8, 6]
intrinsics: [9, 9, 4, 3]
distortion_model: radial-tangential
distortion_coefficients: [-0.2, 0.05, 0.001, 0.0001]
)";
constexpr char kImu[] = R"(T_BS: {data: [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]}
rate_hz: 200
gyroscope_noise_density: 1.0e-4
gyroscope_random_walk: 1.0e-5
accelerometer_noise_density: 1.0e-3
accelerometer_random_walk: 1.0e-4
)";

std::string TextOf(Bytes bytes) { return {bytes.begin(), bytes.end()}; }

// Runs a reader; an Error of one line is an answer like any other.
template <class Read>
void Try(Read&& read) {
  try {
    read();
  } catch (const Error& error) {
    const std::string_view text = error.what();
    if (text.empty()) throw std::logic_error("an Error without words");
    if (text.find('\n') != text.npos) throw std::logic_error("an Error of several lines");
  }
}

// Rectifying a small rig whose calibration was accepted; large ones would only take time.
void TryRectifier(const StereoRig& rig) {
  constexpr int kMaxSide = 64;
  for (const RigCamera& camera : {rig.left, rig.right}) {
    if (camera.camera.pinhole.width > kMaxSide || camera.camera.pinhole.height > kMaxSide) return;
  }
  Try([&] { StereoRectifier{rig}; });
}

void FuzzMap(Bytes bytes) {
  const TemporaryFolder folder;
  const fs::path file = folder.Write("map.db", TextOf(bytes));
  Try([&] { ReadMap(file); });
  Try([&] { ReadPlaceRecord(file); });
  Try([&] { FormatMapSummary(SummarizeMap(file)); });
}

// The bytes as left camera, as right camera and as IMU beside good ones, and alone.
void FuzzEurocCalibration(Bytes bytes) {
  const TemporaryFolder folder;
  const std::string text = TextOf(bytes);
  const auto read = [&](const char* left, const char* right, const char* imu) {
    folder.Write("cam0/sensor.yaml", left);
    folder.Write("cam1/sensor.yaml", right);
    folder.Write("imu0/sensor.yaml", imu);
    Try([&] { TryRectifier(ReadEurocRig(folder.path())); });
  };
  read(text.c_str(), kRightCamera, kImu);
  read(kCamera, text.c_str(), kImu);
  read(kCamera, kRightCamera, text.c_str());
  const fs::path file = folder.Write("camera.yaml", text);
  Try([&] { ReadCamera(file); });
}

void FuzzKalibrCalibration(Bytes bytes) {
  const TemporaryFolder folder;
  const fs::path file = folder.Write("camchain.yaml", TextOf(bytes));
  Try([&] { TryRectifier(ReadKalibrRig(file)); });
  Try([&] { ReadKalibrRig(file, file); });
  Try([&] { ReadCamera(file); });
}

void FuzzKittiCalibration(Bytes bytes) {
  const TemporaryFolder folder;
  const fs::path file = folder.Write("calib.txt", TextOf(bytes));
  Try([&] { TryRectifier(ReadKittiRig(file, 8, 6)); });
}

void WriteEuroc(const TemporaryFolder& folder, const std::string& images, const std::string& imu) {
  folder.Write("cam0/sensor.yaml", kCamera);
  folder.Write("cam1/sensor.yaml", kRightCamera);
  folder.Write("imu0/sensor.yaml", kImu);
  folder.Write("cam0/data.csv", images);
  folder.Write("cam1/data.csv", images);
  folder.Write("imu0/data.csv", imu);
}

void FuzzImageList(Bytes bytes) {
  const TemporaryFolder folder;
  WriteEuroc(folder, TextOf(bytes), "1,0,0,0,0,0,9.8\n2,0,0,0,0,0,9.8\n");
  Try([&] { ReadEuroc(folder.path()); });
}

void FuzzImuList(Bytes bytes) {
  const TemporaryFolder folder;
  WriteEuroc(folder, "1000,a.png\n2000,b.png\n", TextOf(bytes));
  Try([&] { ReadEuroc(folder.path()); });
}

void FuzzKittiTimes(Bytes bytes) {
  const TemporaryFolder folder;
  folder.Write("times.txt", TextOf(bytes));
  folder.Write("calib.txt", "P0: 9 0 4 0 0 9 3 0 0 0 1 0\nP1: 9 0 4 -1 0 9 3 0 0 0 1 0\n");
  for (const char* camera : {"image_0", "image_1"}) {
    fs::create_directories(folder.path() / camera);
    for (const char* name : {"000000.png", "000001.png"}) {
      cv::imwrite((folder.path() / camera / name).string(), cv::Mat::zeros(6, 8, CV_8UC1));
    }
  }
  Try([&] { ReadKitti(folder.path()); });
}

// As it is, and with times beside it, which KITTI poses take.
void FuzzTrajectory(Bytes bytes) {
  const TemporaryFolder folder;
  const fs::path file = folder.Write("trajectory.txt", TextOf(bytes));
  Try([&] { ReadTrajectory(file); });
  folder.Write("times.txt", "0\n0.1\n");
  Try([&] { ReadTrajectory(file); });
}

// One option of each kind, also within groups.
struct InnerOptions {
  double share = 0.5;
  std::string name = "a";
  template <class V>
  void Visit(V& v) {
    v.Field("share", share, {0, 1}, "A share.");
    v.Field("name", name, "A name.");
  }
};
struct OuterOptions {
  int count = 3;
  bool enabled = true;
  float ratio = 1;
  InnerOptions inner;
  template <class V>
  void Visit(V& v) {
    v.Field("count", count, {1, 10}, "A count.");
    v.Field("enabled", enabled, "A switch.");
    v.Field("ratio", ratio, {0, 100, "px"}, "A ratio.");
    v.Group("inner", inner, "A group.");
  }
  void Validate() const { RequireRanges(*this); }
};

void FuzzOptions(Bytes bytes) {
  const TemporaryFolder folder;
  const fs::path file = folder.Write("options.yaml", TextOf(bytes));
  Try([&] {
    OuterOptions options;
    LoadOptions(file, options);
    // What was accepted reads back.
    folder.Write("again.yaml", DumpOptions(options));
    OuterOptions again;
    ReadOptions(folder.path() / "again.yaml", CollectOptions(again));
  });
}

void FuzzModelPack(Bytes bytes) {
  const TemporaryFolder folder;
  folder.Write("manifest.json", TextOf(bytes));
  folder.Write("network.onnx", "network");
  Try([&] { ReadModelPack(folder.path().string()); });
}

// What was accepted finds a word for every descriptor, and is written as it was read.
void FuzzPicture(Bytes bytes) {
  const std::span<const char> file(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  if (const auto grey = DecodeCommonFormat(file); grey && grey->empty()) {
    throw std::logic_error("a picture without pixels");
  }
}

void FuzzVocabulary(Bytes bytes) {
  Try([&] {
    const auto read = Vocabulary::Decode(std::as_bytes(bytes), "vocabulary");
    if (read.empty()) return;
    const DescriptorMatrix descriptors =
        DescriptorMatrix::Identity(std::min(4, read.descriptor_size()), read.descriptor_size());
    for (const WordWeight& word : read.Bag(read.Words(descriptors))) {
      if (word.word < 0 || word.word >= read.words()) throw std::logic_error("a word of none");
      if (!std::isfinite(word.weight)) throw std::logic_error("a word without a weight");
    }
    if (!std::ranges::equal(read.Encode(), std::as_bytes(bytes))) {
      throw std::logic_error("a vocabulary is written otherwise than it was read");
    }
  });
}

constexpr std::array<FuzzTarget, 12> kTargets = {{{"map", FuzzMap},
                                                  {"euroc_calibration", FuzzEurocCalibration},
                                                  {"kalibr_calibration", FuzzKalibrCalibration},
                                                  {"kitti_calibration", FuzzKittiCalibration},
                                                  {"image_list", FuzzImageList},
                                                  {"imu_list", FuzzImuList},
                                                  {"kitti_times", FuzzKittiTimes},
                                                  {"trajectory", FuzzTrajectory},
                                                  {"options", FuzzOptions},
                                                  {"model_pack", FuzzModelPack},
                                                  {"picture", FuzzPicture},
                                                  {"vocabulary", FuzzVocabulary}}};

}  // namespace

std::span<const FuzzTarget> FuzzTargets() { return kTargets; }

const FuzzTarget* FindFuzzTarget(std::string_view name) {
  for (const FuzzTarget& target : kTargets) {
    if (target.name == name) return &target;
  }
  return nullptr;
}

}  // namespace airslam
