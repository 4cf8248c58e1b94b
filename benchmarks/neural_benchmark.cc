// SPDX-License-Identifier: BSD-3-Clause
// What the neural layer costs, at 752x480. The model pack is the default one, or the one that the
// environment variable AIRSLAM_MODEL names, by name or folder.
#include <benchmark/benchmark.h>

#include <cstdio>
#include <cstdlib>
#include <memory>
#include <numeric>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "airslam/common/error.h"
#include "airslam/neural/keypoint_decoder.h"
#include "airslam/neural/line_decoder.h"
#include "airslam/neural/nearest_matcher.h"
#include "airslam/neural/plnet.h"
#include "airslam/neural/transformer_matcher.h"

namespace airslam {
namespace {

constexpr int kKeypoints = 350;  // the paper's number for mapping
const cv::Size kSize(752, 480);

ModelPack Pack() {
  const char* name = std::getenv("AIRSLAM_MODEL");
  return LoadModelPack(name == nullptr ? kDefaultModelPack : name);
}

// Rectangles of random grey with some noise: corners everywhere, the same at every run.
cv::Mat Picture(int shift) {
  cv::RNG random(7);
  cv::Mat image(kSize, CV_8UC1, cv::Scalar(110));
  for (int i = 0; i < 300; ++i) {
    const cv::Point corner(random.uniform(-40, kSize.width) + shift,
                           random.uniform(-40, kSize.height));
    const cv::Size size(random.uniform(10, 90), random.uniform(10, 90));
    cv::rectangle(image, cv::Rect(corner, size), cv::Scalar(random.uniform(20, 235)), cv::FILLED);
  }
  cv::Mat noise(kSize, CV_8UC1);
  random.fill(noise, cv::RNG::UNIFORM, 0, 8);
  return image + noise;
}

// Normalise, run the network, decode, sample descriptors. Arguments: threads, bf16 (else f32).
void BM_PlNet(benchmark::State& state) {
  OpenVinoOptions options;
  options.threads = static_cast<int>(state.range(0));
  options.precision = state.range(1) != 0 ? Precision::kBf16 : Precision::kF32;
  PlNet plnet(Pack().features, OpenVinoLoader(options));
  const cv::Mat image = Picture(0);
  plnet.PrepareFeatures(kSize);
  for (auto _ : state) {
    benchmark::DoNotOptimize(plnet.Detect(image, cv::Mat(), kKeypoints));
  }
}
BENCHMARK(BM_PlNet)
    ->ArgNames({"threads", "bf16"})
    ->ArgsProduct({{1, 2}, {0, 1}})
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

// The same with lines, on one core. Argument: bf16 (else f32).
void BM_PlNetWithLines(benchmark::State& state) {
  OpenVinoOptions options;
  options.precision = state.range(0) != 0 ? Precision::kBf16 : Precision::kF32;
  PlNet plnet(Pack().features, OpenVinoLoader(options));
  const cv::Mat image = Picture(0);
  plnet.PrepareFeatures(kSize);
  plnet.PrepareLines(kSize);
  for (auto _ : state) {
    benchmark::DoNotOptimize(plnet.Detect(image, cv::Mat(), {kKeypoints, true}));
  }
}
BENCHMARK(BM_PlNetWithLines)
    ->ArgName("bf16")
    ->Arg(0)
    ->Arg(1)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

// Lines in the maps of an image that was seen before, as for a keyframe's left image: neck,
// proposals, pooling, classifier.
void BM_FindLines(benchmark::State& state) {
  PlNet plnet(Pack().features);
  const cv::Mat image = Picture(0);
  plnet.PrepareFeatures(kSize);
  plnet.PrepareLines(kSize);
  DetectionRequest request(kKeypoints, true);
  request.keep_maps = true;
  const Detections seen = plnet.Detect(image, cv::Mat(), request);
  for (auto _ : state) {
    benchmark::DoNotOptimize(plnet.FindLines(image, cv::Mat(), seen, request));
  }
}
BENCHMARK(BM_FindLines)->Unit(benchmark::kMillisecond)->UseRealTime();

void BM_Normalize(benchmark::State& state) {
  const cv::Mat image = Picture(0);
  std::vector<float> out(image.total());
  for (auto _ : state) {
    NormalizeImage(image, Normalization::kStandardize, kSize.width, kSize.height, out.data());
    benchmark::DoNotOptimize(out.data());
  }
}
BENCHMARK(BM_Normalize)->Unit(benchmark::kMillisecond);

// Keypoints out of a score map of the pack's network. Argument: spread in per cent.
void BM_DecodeKeypoints(benchmark::State& state) {
  const FeatureNetworkSpec spec = Pack().features;
  const int m = spec.multiple;
  const std::int64_t width = (kSize.width + m - 1) / m * m, height = (kSize.height + m - 1) / m * m;
  const auto network =
      LoadOpenVinoNetwork(spec.network.path, {{spec.input, {1, 1, height, width}}});
  std::vector<float> image(static_cast<std::size_t>(width * height));
  NormalizeImage(Picture(0), spec.normalization, static_cast<int>(width), static_cast<int>(height),
                 image.data());
  const NamedTensor input{spec.input, {image.data(), {1, 1, height, width}}};
  network->Run({&input, 1});
  const int stride = spec.score_stride;
  const FeatureMap cells{network->Output(spec.scores).data, static_cast<int>(width) / stride,
                         static_cast<int>(height) / stride, stride * stride, stride};
  std::vector<float> plane(image.size());
  const ScoreMap scores{plane.data(), kSize.width, kSize.height, static_cast<int>(width)};
  KeypointDecoderOptions options;
  options.max_keypoints = kKeypoints;
  options.score_threshold = spec.score_threshold;
  options.nms_radius = spec.nms_radius;
  options.spread = static_cast<float>(state.range(0)) / 100;
  for (auto _ : state) {
    UnfoldCells(cells, plane.data());
    benchmark::DoNotOptimize(DecodeKeypoints(scores, cv::Mat(), options));
  }
}
BENCHMARK(BM_DecodeKeypoints)->ArgName("spread")->Arg(0)->Arg(50)->Unit(benchmark::kMillisecond);

void BM_SampleAtKeypoints(benchmark::State& state) {
  constexpr int kChannels = 64, kStride = 4;
  const int width = kSize.width / kStride, height = kSize.height / kStride;
  std::vector<float> map(static_cast<std::size_t>(kChannels * height * width));
  std::iota(map.begin(), map.end(), 0.0F);
  cv::RNG random(1);
  std::vector<Keypoint> keypoints(kKeypoints);
  for (Keypoint& k : keypoints) {
    k.x = random.uniform(4.0F, static_cast<float>(kSize.width) - 4);
    k.y = random.uniform(4.0F, static_cast<float>(kSize.height) - 4);
  }
  std::vector<float> samples(static_cast<std::size_t>(kKeypoints * kChannels));
  for (auto _ : state) {
    SampleAtKeypoints({map.data(), width, height, kChannels, kStride}, keypoints, true,
                      samples.data(), kChannels);
    benchmark::DoNotOptimize(samples.data());
  }
}
BENCHMARK(BM_SampleAtKeypoints)->Unit(benchmark::kMillisecond);

// Features of two pictures that are shifted by 8 pixels.
struct PairOfFeatures {
  explicit PairOfFeatures(const ModelPack& pack, int count = kKeypoints) {
    PlNet plnet(pack.features);
    first = plnet.Detect(Picture(0), cv::Mat(), count);
    second = plnet.Detect(Picture(8), cv::Mat(), count);
  }
  MatcherInput input0() const { return {first.keypoints, first.descriptors, kSize}; }
  MatcherInput input1() const { return {second.keypoints, second.descriptors, kSize}; }

  Detections first, second;
};

void BM_NearestMatcher(benchmark::State& state) {
  const PairOfFeatures features(Pack());
  NearestMatcher matcher;
  for (auto _ : state) {
    benchmark::DoNotOptimize(matcher.Match(features.input0(), features.input1()));
  }
}
BENCHMARK(BM_NearestMatcher)->Unit(benchmark::kMillisecond);

// Arguments: bf16 (else f32); whether it may stop early.
void BM_TransformerMatcher(benchmark::State& state) {
  ModelPack pack = Pack();
  if (!pack.matcher) {
    state.SkipWithError("the model pack has no matcher");
    return;
  }
  OpenVinoOptions options;
  options.precision = state.range(0) != 0 ? Precision::kBf16 : Precision::kF32;
  if (state.range(1) == 0) pack.matcher->exit_confidence = 1;  // nothing is ever so sure
  TransformerMatcher matcher(*pack.matcher, pack.features.descriptor_size, OpenVinoLoader(options));
  const PairOfFeatures features(pack, pack.matcher->keypoints);
  for (auto _ : state) {
    benchmark::DoNotOptimize(matcher.Match(features.input0(), features.input1()));
  }
  state.counters["stages"] = matcher.statistics().MeanStages();
}
BENCHMARK(BM_TransformerMatcher)
    ->ArgNames({"bf16", "exit"})
    ->ArgsProduct({{0, 1}, {0, 1}})
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

}  // namespace
}  // namespace airslam

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 2;
  try {
    benchmark::RunSpecifiedBenchmarks();
  } catch (const airslam::Error& error) {
    std::fprintf(stderr, "neural_benchmark: %s\n", error.what());
    return 1;
  }
  return 0;
}
