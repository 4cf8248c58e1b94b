// SPDX-License-Identifier: BSD-3-Clause
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>

#include "airslam/app/commands.h"
#include "airslam/app/output_folder.h"
#include "airslam/calibrate/calibration_check.h"
#include "airslam/calibrate/epipolar_picture.h"
#include "airslam/common/error.h"
#include "airslam/common/log.h"
#include "airslam/dataset/image_file.h"
#include "airslam/neural/make_matcher.h"
#include "airslam/neural/model_pack.h"
#include "airslam/neural/plnet.h"

namespace airslam {
namespace {

namespace fs = std::filesystem;

struct CheckArguments {
  std::string dataset;
  std::string out;
  std::string model = kDefaultModelPack;
  int frames = RawMatchOptions().frames;
  bool json = false;
};

// Pictures of up to six of the frames, and the report as JSON.
void WriteResults(const Sequence& sequence, const CalibrationReport& report, const fs::path& out) {
  constexpr std::size_t kPictures = 6;
  PrepareFolder(out);
  const std::vector<int>& frames = report.matches.frames;
  const std::size_t step = std::max<std::size_t>(1, frames.size() / kPictures);
  for (std::size_t i = 0; i < frames.size(); i += step) {
    const StereoPair pair = sequence.Read(frames[i]);
    WritePicture((out / fmt::format("epipolar_{:06d}.png", frames[i])).string(),
                 DrawEpipolarCurves(sequence.rig(), pair, report.matches, frames[i]));
  }
  WriteText(out / "calibration.json", CalibrationReportToJson(report).dump(1) + '\n');
}

void RunCheck(const CheckArguments& arguments) {
  const std::unique_ptr<Sequence> sequence = OpenSequence(arguments.dataset);
  for (const std::string& warning : sequence->warnings()) LogWarn("{}", warning);
  const ModelPack pack = LoadModelPack(arguments.model);
  PlNet detector(pack.features);
  const std::unique_ptr<FeatureMatcher> matcher = MakeMatcher(pack);
  RawMatchOptions options;
  options.frames = arguments.frames;
  const CalibrationReport report = CheckCalibration(*sequence, detector, *matcher, options);
  if (!arguments.out.empty()) WriteResults(*sequence, report, arguments.out);
  const std::string text = arguments.json ? CalibrationReportToJson(report).dump(2) + '\n'
                                          : FormatCalibrationReport(report);
  std::fputs(text.c_str(), stdout);
  if (!report.right) Fail("{}", report.sentence);
}

}  // namespace

void AddCheckCalibCommand(CLI::App& app) {
  const auto arguments = std::make_shared<CheckArguments>();
  CLI::App* command = app.add_subcommand(
      "check-calib",
      "Check a sequence's calibration on its own images and IMU, and say what is wrong");
  command->add_option("dataset", arguments->dataset, "EuRoC (holds mav0) or KITTI odometry folder")
      ->required();
  command->add_option("--out", arguments->out,
                      "Folder for pictures with epipolar lines and calibration.json");
  command->add_option("--frames", arguments->frames, "Frames to match, spread over the sequence")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  command->add_option("--model", arguments->model, "Model pack: a name or a folder");
  command->add_flag("--json", arguments->json, "Print JSON");
  command->callback([arguments] { RunCheck(*arguments); });
}

}  // namespace airslam
