// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <memory>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "airslam/app/commands.h"
#include "airslam/app/picture.h"
#include "airslam/common/error.h"
#include "airslam/common/log.h"
#include "airslam/dataset/image_file.h"
#include "airslam/neural/model_pack.h"
#include "airslam/neural/nearest_matcher.h"
#include "airslam/neural/plnet.h"
#include "airslam/neural/transformer_matcher.h"

namespace airslam {
namespace {

struct FeaturesArguments {
  std::string image0, image1;
  std::string picture;
  std::string csv;
  std::string model = kDefaultModelPack;
  std::string matcher = "transformer";
  int max_keypoints = 400;
};

double MillisecondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
      .count();
}

// Both images side by side, all keypoints grey-blue, matches green (sure) to yellow.
cv::Mat Draw(const cv::Mat& image0, const cv::Mat& image1, const Detections& features0,
             const Detections& features1, const std::vector<Match>& matches) {
  cv::Mat canvas(std::max(image0.rows, image1.rows), image0.cols + image1.cols, CV_8UC3,
                 cv::Scalar::all(0));
  const cv::Rect left(0, 0, image0.cols, image0.rows);
  const cv::Rect right(image0.cols, 0, image1.cols, image1.rows);
  cv::cvtColor(image0, canvas(left), cv::COLOR_GRAY2BGR);
  cv::cvtColor(image1, canvas(right), cv::COLOR_GRAY2BGR);
  constexpr int kShift = 3;  // circles and lines are drawn at eighths of a pixel
  const auto at = [](const Keypoint& k, int offset) {
    return cv::Point(cvRound((k.x + static_cast<float>(offset)) * (1 << kShift)),
                     cvRound(k.y * (1 << kShift)));
  };
  const auto circles = [&](const Detections& features, int offset, const cv::Scalar& colour) {
    for (const Keypoint& k : features.keypoints) {
      cv::circle(canvas, at(k, offset), 2 << kShift, colour, 1, cv::LINE_AA, kShift);
    }
  };
  circles(features0, 0, {210, 150, 60});
  circles(features1, image0.cols, {210, 150, 60});
  for (const Match& match : matches) {
    const Keypoint& k0 = features0.keypoints[static_cast<std::size_t>(match.index0)];
    const Keypoint& k1 = features1.keypoints[static_cast<std::size_t>(match.index1)];
    const double sure = std::clamp(static_cast<double>(match.score), 0.0, 1.0);
    const cv::Scalar colour(40, 220, 255 * (1 - sure));
    cv::line(canvas, at(k0, 0), at(k1, image0.cols), colour, 1, cv::LINE_AA, kShift);
    cv::circle(canvas, at(k0, 0), 2 << kShift, colour, 1, cv::LINE_AA, kShift);
    cv::circle(canvas, at(k1, image0.cols), 2 << kShift, colour, 1, cv::LINE_AA, kShift);
  }
  return canvas;
}

void WriteMatches(const std::string& file, const Detections& features0, const Detections& features1,
                  const std::vector<Match>& matches) {
  std::ofstream stream(file);
  stream << "x0,y0,x1,y1,score\n";
  for (const Match& match : matches) {
    const Keypoint& k0 = features0.keypoints[static_cast<std::size_t>(match.index0)];
    const Keypoint& k1 = features1.keypoints[static_cast<std::size_t>(match.index1)];
    stream << fmt::format("{:.3f},{:.3f},{:.3f},{:.3f},{:.4f}\n", k0.x, k0.y, k1.x, k1.y,
                          match.score);
  }
  stream.flush();
  if (!stream) Fail("{}: the matches could not be written", file);
}

// The matcher that was asked for, if the pack has it.
std::unique_ptr<FeatureMatcher> MakeMatcher(const std::string& kind, const ModelPack& pack) {
  if (kind == "transformer" && pack.matcher) {
    return std::make_unique<TransformerMatcher>(*pack.matcher, pack.features.descriptor_size);
  }
  if (kind == "transformer") {
    LogWarn("the model pack '{}' has no matcher: matching nearest neighbours", pack.name);
  }
  return std::make_unique<NearestMatcher>();
}

void RunFeatures(const FeaturesArguments& arguments) {
  const cv::Mat image0 = ReadGreyPicture(arguments.image0);
  const cv::Mat image1 = ReadGreyPicture(arguments.image1);
  const ModelPack pack = LoadModelPack(arguments.model);
  PlNet plnet(pack.features);
  plnet.PrepareFeatures(image0.size());
  plnet.PrepareFeatures(image1.size());
  const std::unique_ptr<FeatureMatcher> matcher = MakeMatcher(arguments.matcher, pack);

  const auto match = [&](const Detections& features0, const Detections& features1) {
    return matcher->Match({features0.keypoints, features0.descriptors, image0.size()},
                          {features1.keypoints, features1.descriptors, image1.size()});
  };
  // The first run of a network sets it up: what is timed is the second.
  const Detections features0 = plnet.Detect(image0, cv::Mat(), arguments.max_keypoints);
  const Detections features1 = plnet.Detect(image1, cv::Mat(), arguments.max_keypoints);
  match(features0, features1);
  auto start = std::chrono::steady_clock::now();
  plnet.Detect(image0, cv::Mat(), arguments.max_keypoints);
  plnet.Detect(image1, cv::Mat(), arguments.max_keypoints);
  const double detect_ms = MillisecondsSince(start) / 2;
  start = std::chrono::steady_clock::now();
  const std::vector<Match> matches = match(features0, features1);
  const double match_ms = MillisecondsSince(start);

  if (!arguments.picture.empty()) {
    WritePicture(arguments.picture, Draw(image0, image1, features0, features1, matches));
  }
  if (!arguments.csv.empty()) WriteMatches(arguments.csv, features0, features1, matches);
  std::printf("model pack    %s\n", pack.name.c_str());
  std::printf("keypoints     %zu and %zu, %.1f ms an image\n", features0.keypoints.size(),
              features1.keypoints.size(), detect_ms);
  std::printf("matches       %zu, %.1f ms", matches.size(), match_ms);
  if (const auto* transformer = dynamic_cast<const TransformerMatcher*>(matcher.get())) {
    std::printf(", %.0f of %zu stages", transformer->statistics().MeanStages(),
                pack.matcher->stages.size());
  }
  std::printf("\n");
}

}  // namespace

void AddFeaturesCommand(CLI::App& app) {
  auto arguments = std::make_shared<FeaturesArguments>();
  CLI::App* command = app.add_subcommand("features", "Detect, match and draw two images' features");
  command->add_option("image0", arguments->image0, "First image")->required();
  command->add_option("image1", arguments->image1, "Second image")->required();
  command->add_option("--out", arguments->picture, "Picture to write (.png or .jpg)");
  command->add_option("--csv", arguments->csv, "Table of the matches to write");
  command->add_option("--model", arguments->model, "Model pack, by name or folder")
      ->capture_default_str();
  command->add_option("--matcher", arguments->matcher, "How to match")
      ->check(CLI::IsMember({"transformer", "nearest"}))
      ->capture_default_str();
  command->add_option("--max-keypoints", arguments->max_keypoints, "Keypoints of each image")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  command->callback([arguments] { RunFeatures(*arguments); });
}

}  // namespace airslam
