// SPDX-License-Identifier: BSD-3-Clause
#include <ceres/version.h>
#include <sqlite3.h>
#include <stdlib.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <functional>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "airslam/app/commands.h"
#include "airslam/common/error.h"
#include "airslam/common/version.h"
#include "airslam/geometry/so3.h"
#include "airslam/map/map_file.h"
#include "airslam/neural/model_pack.h"
#include "airslam/neural/nearest_matcher.h"
#include "airslam/neural/openvino_network.h"
#include "airslam/neural/plnet.h"
#include "airslam/neural/transformer_matcher.h"
#include "airslam/optimize/pose_optimization.h"

namespace airslam {
namespace {

// A rectangle on a rectangle on a rectangle: corners everywhere, the same ones on every machine.
cv::Mat TestPicture() {
  cv::Mat picture(480, 752, CV_8UC1, cv::Scalar(90));
  std::mt19937 random(1);
  for (int i = 0; i < 300; ++i) {
    const auto x = static_cast<int>(random() % 752), y = static_cast<int>(random() % 480);
    const auto w = static_cast<int>(12 + random() % 60), h = static_cast<int>(12 + random() % 60);
    const double grey = random() % 256;
    cv::rectangle(picture, {x, y, w, h}, cv::Scalar(grey), cv::FILLED);
  }
  cv::GaussianBlur(picture, picture, {}, 0.8);
  return picture;
}

bool SameBits(const Detections& a, const Detections& b) {
  return a.keypoints.size() == b.keypoints.size() && a.descriptors.size() == b.descriptors.size() &&
         std::memcmp(a.keypoints.data(), b.keypoints.data(),
                     a.keypoints.size() * sizeof(Keypoint)) == 0 &&
         std::memcmp(a.descriptors.data(), b.descriptors.data(),
                     static_cast<std::size_t>(a.descriptors.size()) * sizeof(float)) == 0;
}

std::string CheckCpu() {
  const unsigned cores = std::thread::hardware_concurrency();
  if (cores < 2) {
    Fail("{} core: mapping works, at about half the speed; give the machine a second one", cores);
  }
#if defined(__x86_64__)
  const bool int8 = __builtin_cpu_supports("avx512vnni") || __builtin_cpu_supports("avxvnni"),
             avx2 = __builtin_cpu_supports("avx2");
#else
  const bool int8 = false, avx2 = false;
#endif
  return fmt::format("{} cores; used: {}{}{}", cores,
                     int8   ? "int8 (VNNI)"
                     : avx2 ? "AVX2, int8 without VNNI: networks take six times as long"
                            : "no AVX2: slow",
                     IsFasterInBf16() ? ", bf16" : ", f32", avx2 ? ", AVX2" : "");
}

std::string CheckPack(const ModelPack& pack) {
  return fmt::format(
      "{} in {}, every file as its SHA-256 says; lines {}, matcher {}, vocabulary {}", pack.name,
      pack.folder, pack.features.lines ? "yes" : "no", pack.matcher ? "yes" : "no",
      pack.vocabulary ? "yes" : "no");
}

// The SHA-256 of each file of the pack.
void PrintHashes(const ModelPack& pack) {
  std::vector<const PackFile*> files = {&pack.features.network};
  if (pack.features.descriptor_head) files.push_back(&pack.features.descriptor_head->network);
  if (pack.features.lines) {
    files.push_back(&pack.features.lines->network);
    files.push_back(&pack.features.lines->classifier.network);
  }
  if (pack.matcher) {
    for (const PackFile& stage : pack.matcher->stages) files.push_back(&stage);
  }
  if (pack.vocabulary) files.push_back(&*pack.vocabulary);
  std::printf("       %-10s %s manifest.json\n", "hashes", pack.sha256.c_str());
  for (const PackFile* file : files) {
    std::printf("       %-10s %s %s\n", "", file->sha256.c_str(),
                std::filesystem::path(file->path).filename().c_str());
  }
}

// The matcher network finds that points are themselves.
std::string CheckMatcher(const ModelPack& pack) {
  PlNet detector(pack.features);
  TransformerMatcher matcher(*pack.matcher, pack.features.descriptor_size);
  const cv::Mat picture = TestPicture();
  const Detections seen = detector.Detect(picture, {}, 200);
  const MatcherInput input{seen.keypoints, seen.descriptors, picture.size()};
  const std::vector<Match> matches = matcher.Match(input, input);
  const auto right = std::count_if(matches.begin(), matches.end(),
                                   [](const Match& m) { return m.index0 == m.index1; });
  if (10 * right < 9 * static_cast<std::ptrdiff_t>(seen.keypoints.size())) {
    Fail("only {} of {} points are matched with themselves: the pack does not work on this CPU",
         right, seen.keypoints.size());
  }
  return fmt::format("{} of {} points matched with themselves", right, seen.keypoints.size());
}

// A map is written, read back and removed.
std::string CheckMapFile() {
  namespace fs = std::filesystem;
  std::error_code error;
  const fs::path place = fs::temp_directory_path(error);
  std::string name = (place / "airslam_doctor_XXXXXX").string();
  if (error || mkdtemp(name.data()) == nullptr) {
    Fail("no temporary folder can be made: set TMPDIR to a folder that can be written");
  }
  const std::unique_ptr<std::string, void (*)(std::string*)> folder(&name, [](std::string* path) {
    std::error_code ignored;
    fs::remove_all(*path, ignored);
  });
  const fs::path file = fs::path(name) / "map.db";
  MapCalibration calibration;
  calibration.stereo = {{450, 450, 376, 240, 752, 480}, 0.11};
  MapWriter(file, calibration, "doctor", "none").Close();
  if (ReadMap(file).calibration.stereo.baseline != 0.11) {
    Fail(
        "a map reads back otherwise than it was written: SQLite of this machine is broken; "
        "reinstall libsqlite3-0");
  }
  return fmt::format("written and read back in {}, format {}", place.string(), kMapFormatVersion);
}

std::string CheckCache() {
  const std::string folder = DefaultCacheFolder();
  if (folder.empty()) {
    Fail(
        "no folder to keep compiled networks in: each start takes about a second longer; "
        "make ~/.cache writable or set XDG_CACHE_HOME");
  }
  return folder;
}

// Two answers to one picture have the same bits, and the picture moved by whole cells of the
// network matches itself.
std::string CheckInference(const ModelPack& pack) {
  PlNet detector(pack.features);
  const cv::Mat picture = TestPicture();
  const Detections first = detector.Detect(picture, {}, 350);
  Detections again;
  double ms = 1e9;  // of the quickest of a few: other programs may run
  for (int i = 0; i < 5; ++i) {
    const auto start = std::chrono::steady_clock::now();
    again = detector.Detect(picture, {}, 350);
    const std::chrono::duration<double, std::milli> taken =
        std::chrono::steady_clock::now() - start;
    ms = std::min(ms, taken.count());
  }
  if (first.keypoints.size() < 100) {
    Fail(
        "{} keypoints in the test picture, expected at least 100: the pack does not work on this "
        "CPU",
        first.keypoints.size());
  }
  if (!SameBits(first, again)) Fail("two runs on one picture differ: results will not repeat");
  constexpr int shift = 32;
  const Detections moved = detector.Detect(
      picture(cv::Rect(shift, 0, picture.cols - shift, picture.rows)).clone(), {}, 350);
  int right = 0;
  const auto matches = NearestMatcher().Match({first.keypoints, first.descriptors, picture.size()},
                                              {moved.keypoints, moved.descriptors, picture.size()});
  for (const Match& m : matches) {
    const Keypoint& a = first.keypoints[static_cast<std::size_t>(m.index0)];
    const Keypoint& b = moved.keypoints[static_cast<std::size_t>(m.index1)];
    right += std::hypot(a.x - b.x - static_cast<float>(shift), a.y - b.y) < 2;
  }
  if (2 * right < static_cast<int>(matches.size()) || right < 50) {
    Fail("{} of {} matches of the moved test picture are right: the pack does not work on this CPU",
         right, matches.size());
  }
  return fmt::format(
      "{} keypoints, {} of {} matches right, the same bits twice, {:.1f} ms at "
      "752x480 on one core",
      first.keypoints.size(), right, matches.size(), ms);
}

// A pose that is 5 cm and 3 degrees off is found again from a hundred points.
std::string CheckSolver() {
  const StereoCamera stereo{{450, 455, 376, 240, 752, 480}, 0.12};
  const Rigid3 truth(ExpSO3({0.1, -0.2, 0.05}), {0.3, -0.1, 0.2});
  std::mt19937 random(2);
  std::uniform_real_distribution<double> unit(-1, 1);
  std::vector<PointConstraint> constraints;
  for (int i = 0; i < 100; ++i) {
    const Eigen::Vector3d in_cam(2 * unit(random), unit(random), 4 + unit(random));
    const Eigen::Vector2d pixel = stereo.camera.Project(in_cam);
    constraints.push_back({truth * in_cam, {pixel, pixel.x() - stereo.Disparity(in_cam.z()), 1.0}});
  }
  const Rigid3 start = truth * Rigid3(ExpSO3({0.03, -0.03, 0.03}), {0.03, 0.03, -0.03});
  const Rigid3 found = OptimizePose(stereo, constraints, start, std::nullopt, {}).world_from_cam;
  const double error = (truth.Inverse() * found).translation.norm();
  if (!(error < 1e-6)) {
    Fail(
        "a known pose was missed by {} m: Ceres or Eigen of this machine is broken; reinstall "
        "libceres-dev and libeigen3-dev and build again",
        error);
  }
  return fmt::format("a known pose found within {:.0e} m", error);
}

// Prints a line for the check; what it throws is what is wrong and what to do.
bool Report(const char* name, const std::function<std::string()>& check) {
  try {
    std::printf("ok     %-10s %s\n", name, check().c_str());
    return true;
  } catch (const Error& error) {
    std::printf("WRONG  %-10s %s\n", name, error.what());
    return false;
  }
}

void RunDoctor(const std::string& model) {
  std::printf(
      "       %-10s airslam %s, OpenVINO %s, OpenCV %s, Ceres %s, Eigen %d.%d.%d, "
      "SQLite %s, compiler %s\n",
      "versions", kVersion, OpenVinoVersion().c_str(), CV_VERSION, CERES_VERSION_STRING,
      EIGEN_WORLD_VERSION, EIGEN_MAJOR_VERSION, EIGEN_MINOR_VERSION, sqlite3_libversion(),
      __VERSION__);
  bool well = Report("cpu", CheckCpu);
  well &= Report("cache", CheckCache);
  well &= Report("solver", CheckSolver);
  well &= Report("map file", CheckMapFile);
  ModelPack pack;
  const bool has_pack = Report("models", [&] {
    pack = LoadModelPack(model);
    return CheckPack(pack);
  });
  if (has_pack) PrintHashes(pack);
  well &= has_pack && Report("inference", [&] { return CheckInference(pack); });
  if (has_pack && pack.matcher) well &= Report("matcher", [&] { return CheckMatcher(pack); });
  if (!well) Fail("doctor: something is wrong, see the lines above");
}

}  // namespace

void AddDoctorCommand(CLI::App& app) {
  const auto model = std::make_shared<std::string>(kDefaultModelPack);
  CLI::App* command = app.add_subcommand(
      "doctor", "Check this machine: CPU, models, inference and solver, and say what to do");
  command->add_option("--model", *model, "Model pack: a name or a folder");
  command->callback([model] { RunDoctor(*model); });
}

}  // namespace airslam
