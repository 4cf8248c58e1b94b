// SPDX-License-Identifier: BSD-3-Clause
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "airslam/app/commands.h"
#include "airslam/app/picture.h"
#include "airslam/common/error.h"
#include "airslam/common/log.h"
#include "airslam/common/progress.h"
#include "airslam/neural/model_pack.h"
#include "airslam/neural/plnet.h"
#include "airslam/place/vocabulary_training.h"

namespace airslam {
namespace {

struct TrainVocabularyArguments {
  std::string input;
  std::string out;
  std::string model = kDefaultModelPack;
  int max_keypoints = 400;
  VocabularyOptions vocabulary;
};

// The keypoint descriptors of every picture; those that cannot be read are left out, with a
// warning.
std::vector<DescriptorMatrix> DetectDescriptors(const std::vector<std::filesystem::path>& files,
                                                PlNet& plnet, int max_keypoints) {
  std::vector<DescriptorMatrix> images;
  Progress progress("detect", static_cast<int>(files.size()));
  for (std::size_t i = 0; i < files.size(); ++i) {
    try {
      const cv::Mat image = ReadGreyPicture(files[i].string());
      images.push_back(plnet.Detect(image, cv::Mat(), max_keypoints).descriptors);
    } catch (const Error& error) {
      LogWarn("{}", error.what());
    }
    progress.Update(static_cast<int>(i) + 1, files[i].filename().string());
  }
  progress.Finish(static_cast<int>(files.size()), "");
  return images;
}

void RunTrainVocabulary(const TrainVocabularyArguments& arguments) {
  arguments.vocabulary.Validate();
  const std::vector<std::filesystem::path> files = ListPictures(arguments.input);
  const ModelPack pack = LoadModelPack(arguments.model);
  PlNet plnet(pack.features);
  const std::vector<DescriptorMatrix> images =
      DetectDescriptors(files, plnet, arguments.max_keypoints);
  std::int64_t descriptors = 0;
  for (const DescriptorMatrix& image : images) descriptors += image.rows();
  Progress progress("cluster", static_cast<int>(descriptors));
  const auto report = [&](std::int64_t done) { progress.Update(static_cast<int>(done), ""); };
  const Vocabulary vocabulary =
      TrainVocabulary(images, pack.features.network.sha256, arguments.vocabulary, report);
  progress.Finish(static_cast<int>(descriptors), "");
  vocabulary.Write(arguments.out);
  std::printf("%d words from %lld descriptors of %zu pictures; vocabulary in %s\n",
              vocabulary.words(), static_cast<long long>(descriptors), images.size(),
              arguments.out.c_str());
}

}  // namespace

void AddTrainVocabularyCommand(CLI::App& app) {
  auto arguments = std::make_shared<TrainVocabularyArguments>();
  CLI::App* command = app.add_subcommand("train-vocabulary",
                                         "Words for place recognition, from a folder of pictures");
  command->add_option("input", arguments->input, "Folder of pictures of all kinds of places")
      ->required();
  command->add_option("--out", arguments->out, "Vocabulary file to write")->required();
  command->add_option("--model", arguments->model, "Model pack, by name or folder")
      ->capture_default_str();
  command->add_option("--max-keypoints", arguments->max_keypoints, "Keypoints of each picture")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  command->add_option("--branching", arguments->vocabulary.branching, "Children of a node")
      ->capture_default_str();
  command->add_option("--levels", arguments->vocabulary.levels, "Levels of the tree")
      ->capture_default_str();
  command->add_option("--seed", arguments->vocabulary.seed, "Seed of the clustering")
      ->capture_default_str();
  command->callback([arguments] { RunTrainVocabulary(*arguments); });
}

}  // namespace airslam
