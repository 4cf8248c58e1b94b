// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <atomic>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "airslam/app/commands.h"
#include "airslam/app/picture.h"
#include "airslam/common/error.h"
#include "airslam/common/log.h"
#include "airslam/common/options.h"
#include "airslam/dataset/trajectory.h"
#include "airslam/map/keyframe_trajectory.h"
#include "airslam/map/map_file.h"
#include "airslam/neural/make_matcher.h"
#include "airslam/neural/model_pack.h"
#include "airslam/neural/plnet.h"
#include "airslam/relocalize/localizer.h"
#include "airslam/sensor/calibration.h"

namespace airslam {
namespace {

namespace fs = std::filesystem;

struct LocalizeArguments {
  std::string map;
  std::vector<std::string> inputs;
  std::string camera;
  std::string out;
  std::string config;
  std::string model = kDefaultModelPack;
  std::optional<int> candidates;
  bool no_structure_graph = false;
  int threads = 0;
};

// The configuration file's options, then those of the command line.
LocalizationOptions Options(const LocalizeArguments& arguments) {
  LocalizationOptions options;
  if (!arguments.config.empty()) LoadOptions(arguments.config, options);
  if (arguments.candidates) options.candidates = *arguments.candidates;
  if (arguments.no_structure_graph) options.structure_graph = false;
  options.Validate();
  return options;
}

std::vector<fs::path> Queries(const std::vector<std::string>& inputs) {
  std::vector<fs::path> files;
  for (const std::string& input : inputs) {
    const std::vector<fs::path> pictures = ListPictures(input);
    files.insert(files.end(), pictures.begin(), pictures.end());
  }
  return files;
}

// The time that a file's name tells in nanoseconds (ten digits or more), else the running number in
// seconds.
std::int64_t Timestamp(const fs::path& file, std::size_t number) {
  const std::string name = file.stem().string();
  std::int64_t time = 0;
  const auto [end, error] = std::from_chars(name.data(), name.data() + name.size(), time);
  const bool told = error == std::errc() && end == name.data() + name.size() && name.size() >= 10;
  return told && time >= 0 ? time : static_cast<std::int64_t>(number) * 1'000'000'000;
}

// One line about a query.
std::string Describe(const fs::path& file, const Localization& answer) {
  const auto& ms = answer.milliseconds;
  const std::string times = fmt::format(
      "{:.1f} ms (undistort {:.1f}, detect {:.1f}, retrieve {:.2f}, filter {:.2f}, "
      "verify {:.1f})",
      ms.Total(), ms.undistort, ms.detect, ms.retrieve, ms.filter, ms.verify);
  if (!answer.pose) {
    return fmt::format("{}: refused at {}: {}; {}\n", file.filename().string(),
                       ToString(answer.stage), answer.refusal, times);
  }
  const LocalizedPose& pose = *answer.pose;
  const Eigen::Vector3d& t = pose.world_from_body.translation;
  const Eigen::Quaterniond& q = pose.world_from_body.rotation;
  const double sigma = std::sqrt(pose.covariance.bottomRightCorner<3, 3>().trace());
  return fmt::format(
      "{}: {:.4f} {:.4f} {:.4f} m, q_xyzw {:.5f} {:.5f} {:.5f} {:.5f}, sigma {:.3f} m, {} inliers "
      "with keyframe {}{}; {}\n",
      file.filename().string(), t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w(), sigma,
      pose.inliers, pose.keyframe,
      pose.component == 0 ? "" : fmt::format(" of component {}", pose.component), times);
}

// What a thread needs of its own.
struct Worker {
  Worker(const ModelPack& pack, const LocalizationMap& map, const QueryCamera& camera,
         const LocalizationOptions& options)
      : detector(pack.features),
        matcher(MakeMatcher(pack)),
        localizer(map, detector, *matcher, options) {
    const Pinhole& pinhole = camera.pinhole();
    const cv::Size size(pinhole.width, pinhole.height);
    detector.PrepareFeatures(size);
    if (localizer.uses_structure_graph()) detector.PrepareLines(size);
  }

  PlNet detector;
  std::unique_ptr<FeatureMatcher> matcher;
  Localizer localizer;
};

// Answers the queries on all workers; prints the answers in the order of the queries.
std::vector<Localization> Answer(const std::vector<fs::path>& files, const QueryCamera& camera,
                                 std::vector<std::unique_ptr<Worker>>& workers) {
  std::vector<Localization> answers(files.size());
  std::vector<bool> done(files.size(), false);
  std::atomic<std::size_t> next = 0;
  std::mutex mutex;
  std::size_t printed = 0;
  std::exception_ptr failure;
  const auto work = [&](Worker& worker) {
    try {
      for (std::size_t i = next++; i < files.size(); i = next++) {
        Localization answer = worker.localizer.Localize(ReadGreyPicture(files[i].string()), camera);
        const std::lock_guard lock(mutex);
        answers[i] = std::move(answer);
        done[i] = true;
        for (; printed < files.size() && done[printed]; ++printed) {
          std::fputs(Describe(files[printed], answers[printed]).c_str(), stdout);
        }
      }
    } catch (const Error&) {
      const std::lock_guard lock(mutex);
      if (!failure) failure = std::current_exception();
      next = files.size();
    }
  };
  std::vector<std::thread> threads;
  for (std::size_t i = 1; i < workers.size(); ++i) {
    threads.emplace_back([&, i] { work(*workers[i]); });
  }
  work(*workers.front());
  for (std::thread& thread : threads) thread.join();
  if (failure) std::rethrow_exception(failure);
  return answers;
}

// The poses in one component's world; those of others would not fit to them.
Trajectory Poses(const std::vector<fs::path>& files, const std::vector<Localization>& answers,
                 int component) {
  Trajectory poses;
  for (std::size_t i = 0; i < files.size(); ++i) {
    const std::optional<LocalizedPose>& pose = answers[i].pose;
    if (!pose || pose->component != component) continue;
    poses.push_back({Timestamp(files[i], i), pose->world_from_body});
  }
  return poses;
}

void RunLocalize(const LocalizeArguments& arguments) {
  const LocalizationOptions options = Options(arguments);
  const std::vector<fs::path> files = Queries(arguments.inputs);
  const QueryCamera camera(ReadCamera(arguments.camera));
  const ModelPack pack = LoadModelPack(arguments.model);
  const LocalizationMap map = LocalizationMap::Load(MapFilePath(arguments.map), pack);
  if (options.structure_graph && !map.places.has_junction_words()) {
    LogWarn(
        "the map has no junction words (airslam refine makes them): stage 2 goes by keypoint "
        "words alone");
  }
  std::size_t threads = arguments.threads > 0 ? static_cast<std::size_t>(arguments.threads)
                                              : std::max(1U, std::thread::hardware_concurrency());
  std::vector<std::unique_ptr<Worker>> workers;
  for (std::size_t i = 0; i < std::min(threads, files.size()); ++i) {
    workers.push_back(std::make_unique<Worker>(pack, map, camera, options));
  }
  const auto start = std::chrono::steady_clock::now();
  const std::vector<Localization> answers = Answer(files, camera, workers);
  const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start;
  const Trajectory poses = Poses(files, answers, LargestMapComponent(map.map));
  if (!arguments.out.empty()) WriteTum(arguments.out, poses);
  const auto located = static_cast<std::size_t>(std::count_if(
      answers.begin(), answers.end(), [](const Localization& a) { return a.pose.has_value(); }));
  if (located > poses.size()) {
    LogWarn("{} poses are in the worlds of smaller components: only their lines tell them",
            located - poses.size());
  }
  std::printf("%zu of %zu queries located, %.1f queries/s on %zu threads\n", located, files.size(),
              static_cast<double>(files.size()) / seconds.count(), workers.size());
}

}  // namespace

void AddLocalizeCommand(CLI::App& app) {
  auto arguments = std::make_shared<LocalizeArguments>();
  CLI::App* command =
      app.add_subcommand("localize", "Find where single images were taken, in a finished map");
  command->add_option("map", arguments->map, "The map file, or the folder of airslam map")
      ->required();
  command->add_option("queries", arguments->inputs, "Images, or folders of images")->required();
  command
      ->add_option("--camera", arguments->camera,
                   "Calibration of the queries: EuRoC sensor.yaml, or a Kalibr file (cam0)")
      ->required();
  command->add_option("--out", arguments->out,
                      "TUM file of poses (world from body; time from a name in nanoseconds, else "
                      "the running number)");
  command->add_option("--config", arguments->config, "YAML file of options");
  command->add_option("--candidates", arguments->candidates, "Keyframes to match with");
  command->add_flag("--no-structure-graph", arguments->no_structure_graph,
                    "Choose candidates by keypoint words alone");
  command->add_option("--threads", arguments->threads, "0: one a CPU")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  command->add_option("--model", arguments->model, "Model pack, by name or folder")
      ->capture_default_str();
  command->callback([arguments] { RunLocalize(*arguments); });
}

}  // namespace airslam
