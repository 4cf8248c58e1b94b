// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "airslam/app/commands.h"
#include "airslam/app/output_folder.h"
#include "airslam/app/picture.h"
#include "airslam/common/error.h"
#include "airslam/common/log.h"
#include "airslam/common/progress.h"
#include "airslam/dataset/image_file.h"
#include "airslam/neural/detect_image.h"
#include "airslam/neural/model_pack.h"
#include "airslam/neural/plnet.h"

namespace airslam {
namespace {

namespace fs = std::filesystem;

struct DetectArguments {
  std::string input;
  std::string out;
  std::string model = kDefaultModelPack;
  int max_keypoints = 400;
  float draw_score = 0.3F;
  float line_scale = ImageRequest().line_scale;
  bool draw = false;
};

// The pictures to look at; no two may have one name for their tables.
std::vector<fs::path> Pictures(const std::string& input) {
  const std::vector<fs::path> files = ListPictures(input);
  std::map<std::string, fs::path> names;
  for (const fs::path& file : files) {
    const auto [first, fresh] = names.emplace(file.stem().string(), file);
    if (!fresh) {
      Fail("{} and {} would both be written as '{}': rename one of them", first->second.string(),
           file.string(), first->first);
    }
  }
  return files;
}

std::string KeypointTable(const std::vector<Keypoint>& keypoints) {
  std::string table;
  for (const Keypoint& k : keypoints) {
    table += fmt::format("{:.3f},{:.3f},{:.4f}\n", k.x, k.y, k.score);
  }
  return table;
}

std::string LineTable(const std::vector<LineSegment>& lines) {
  std::string table;
  for (const LineSegment& l : lines) {
    table += fmt::format("{:.3f},{:.3f},{:.3f},{:.3f},{:.5f}\n", l.x1, l.y1, l.x2, l.y2, l.score);
  }
  return table;
}

// Keypoints blue, lines from red (doubtful) to green (sure), their junctions yellow.
cv::Mat Draw(const cv::Mat& image, const Detections& found, float least_score) {
  cv::Mat canvas;
  cv::cvtColor(image, canvas, cv::COLOR_GRAY2BGR);
  constexpr int kShift = 3;  // drawn at eighths of a pixel
  const auto at = [](float x, float y) {
    return cv::Point(cvRound(x * (1 << kShift)), cvRound(y * (1 << kShift)));
  };
  for (const Keypoint& k : found.keypoints) {
    cv::circle(canvas, at(k.x, k.y), 2 << kShift, {210, 150, 60}, 1, cv::LINE_AA, kShift);
  }
  for (auto l = found.lines.rbegin(); l != found.lines.rend(); ++l) {  // the surest on top
    if (l->score < least_score) continue;
    const double sure = std::clamp((l->score - least_score) / (1.001F - least_score), 0.0F, 1.0F);
    cv::line(canvas, at(l->x1, l->y1), at(l->x2, l->y2), {0, 60 + 195 * sure, 255 * (1 - sure)}, 1,
             cv::LINE_AA, kShift);
    for (const cv::Point& end : {at(l->x1, l->y1), at(l->x2, l->y2)}) {
      cv::circle(canvas, end, 2 << kShift, {0, 230, 255}, cv::FILLED, cv::LINE_AA, kShift);
    }
  }
  return canvas;
}

void RunDetect(const DetectArguments& arguments) {
  const std::vector<fs::path> files = Pictures(arguments.input);
  cv::Mat image = ReadGreyPicture(files.front().string());  // before anything is made
  const ModelPack pack = LoadModelPack(arguments.model);
  if (!pack.features.lines) LogWarn("the model pack '{}' finds no lines", pack.name);
  PlNet plnet(pack.features);
  ImageRequest request;
  request.max_keypoints = arguments.max_keypoints;
  request.line_scale = arguments.line_scale;
  const fs::path out = arguments.out;
  PrepareFolder(out);
  Progress progress("detect", static_cast<int>(files.size()));
  std::size_t keypoints = 0, lines = 0;
  for (std::size_t i = 0; i < files.size(); ++i) {
    if (i > 0) image = ReadGreyPicture(files[i].string());
    const Detections found = DetectImage(image, cv::Mat(), request, plnet);
    const std::string name = files[i].stem().string();
    WriteText(out / (name + ".keypoints.csv"), KeypointTable(found.keypoints));
    WriteText(out / (name + ".lines.csv"), LineTable(found.lines));
    if (arguments.draw) {
      WritePicture((out / (name + ".features.png")).string(),
                   Draw(image, found, arguments.draw_score));
    }
    keypoints += found.keypoints.size();
    lines += static_cast<std::size_t>(
        std::count_if(found.lines.begin(), found.lines.end(),
                      [&](const LineSegment& l) { return l.score >= arguments.draw_score; }));
    progress.Update(static_cast<int>(i) + 1, name);
  }
  progress.Finish(static_cast<int>(files.size()), "");
  std::printf("%zu pictures, %zu keypoints, %zu lines of a score over %.2f; tables in %s\n",
              files.size(), keypoints, lines, arguments.draw_score, arguments.out.c_str());
}

}  // namespace

void AddDetectCommand(CLI::App& app) {
  auto arguments = std::make_shared<DetectArguments>();
  CLI::App* command =
      app.add_subcommand("detect", "Keypoints and lines of a picture, or of all in a folder");
  command->add_option("input", arguments->input, "Picture, or folder of pictures")->required();
  command
      ->add_option("--out", arguments->out,
                   "Folder for NAME.keypoints.csv (x,y,score) and NAME.lines.csv "
                   "(x1,y1,x2,y2,score: all proposals, best first)")
      ->required();
  command->add_flag("--draw", arguments->draw, "Write NAME.features.png besides");
  command->add_option("--draw-score", arguments->draw_score, "Draw lines from this score on")
      ->check(CLI::Range(0.0, 1.0))
      ->capture_default_str();
  command
      ->add_option(
          "--line-scale", arguments->line_scale,
          "Look for lines in the picture enlarged by so much, up to a shorter side of 720; "
          "1: in the pass that finds the keypoints, as mapping does")
      ->check(CLI::Range(1.0, 4.0))
      ->capture_default_str();
  command->add_option("--model", arguments->model, "Model pack, by name or folder")
      ->capture_default_str();
  command->add_option("--max-keypoints", arguments->max_keypoints, "Keypoints of each picture")
      ->check(CLI::Range(0, 100000))
      ->capture_default_str();
  command->callback([arguments] { RunDetect(*arguments); });
}

}  // namespace airslam
