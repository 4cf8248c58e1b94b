// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/neural/plnet.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <utility>

#include "airslam/common/error.h"

namespace airslam {
namespace {

// A stereo pair needs one size, a folder of pictures perhaps a few.
constexpr std::size_t kMaxInstances = 4;

// Proposals that the classifier judges in one run.
constexpr std::size_t kClassifierRows = 256;

// Standard deviations below this are the noise of a dark image, not contrast to be stretched.
constexpr double kMinDeviation = 2.0;

int RoundUp(int value, int multiple) { return (value + multiple - 1) / multiple * multiple; }

// The normalised value of each grey level.
std::array<float, 256> NormalizationTable(const cv::Mat& image, Normalization normalization) {
  double mean = 0;
  double scale = 1.0 / 255.0;
  if (normalization == Normalization::kStandardize) {
    std::uint64_t sum = 0, sum_of_squares = 0;  // exact: the result does not depend on the order
    for (int y = 0; y < image.rows; ++y) {
      const std::uint8_t* row = image.ptr<std::uint8_t>(y);
      std::uint32_t row_sum = 0, row_squares = 0;
      for (int x = 0; x < image.cols; ++x) {
        row_sum += row[x];
        row_squares += static_cast<std::uint32_t>(row[x]) * row[x];
      }
      sum += row_sum;
      sum_of_squares += row_squares;
    }
    const auto count = static_cast<double>(image.total());
    mean = static_cast<double>(sum) / count;
    const double variance = static_cast<double>(sum_of_squares) / count - mean * mean;
    scale = 1.0 / std::max(std::sqrt(std::max(variance, 0.0)), kMinDeviation);
  }
  std::array<float, 256> table;
  for (std::size_t i = 0; i < table.size(); ++i) {
    table[i] = static_cast<float>((static_cast<double>(i) - mean) * scale);
  }
  return table;
}

// Four cells of a descriptor map with their weights.
struct BilinearTap {
  std::ptrdiff_t top, bottom;  // offsets of the left cells
  std::ptrdiff_t right;        // step to the right cells
  float w00, w01, w10, w11;    // top left, top right, bottom left, bottom right
};

BilinearTap MakeTap(const Keypoint& k, int stride, bool half_pixel, int width, int height) {
  const auto s = static_cast<float>(stride);
  const auto cell = [&](float pixel, int size) {
    const float c = half_pixel ? (pixel + 0.5F) / s - 0.5F : pixel / s;
    return std::clamp(c, 0.0F, static_cast<float>(size - 1));
  };
  const float x = cell(k.x, width), y = cell(k.y, height);
  const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
  const float ax = x - static_cast<float>(x0), ay = y - static_cast<float>(y0);
  const int y1 = std::min(y0 + 1, height - 1);
  return {static_cast<std::ptrdiff_t>(y0) * width + x0,
          static_cast<std::ptrdiff_t>(y1) * width + x0,
          x0 + 1 < width ? 1 : 0,
          (1 - ax) * (1 - ay),
          ax * (1 - ay),
          (1 - ax) * ay,
          ax * ay};
}

}  // namespace

void NormalizeImage(const cv::Mat& image, Normalization normalization, int width, int height,
                    float* out) {
  const std::array<float, 256> table = NormalizationTable(image, normalization);
  for (int y = 0; y < height; ++y) {
    float* row = out + static_cast<std::ptrdiff_t>(y) * width;
    if (y >= image.rows) {
      std::copy_n(row - width, width, row);
      continue;
    }
    const std::uint8_t* source = image.ptr<std::uint8_t>(y);
    for (int x = 0; x < image.cols; ++x) row[x] = table[source[x]];
    std::fill(row + image.cols, row + width, row[image.cols - 1]);
  }
}

DescriptorMatrix SampleDescriptors(const TensorView& map, std::span<const Keypoint> keypoints,
                                   int stride, bool half_pixel) {
  const int size = static_cast<int>(map.shape[1]);
  const int height = static_cast<int>(map.shape[2]);
  const int width = static_cast<int>(map.shape[3]);
  std::vector<BilinearTap> taps;
  taps.reserve(keypoints.size());
  for (const Keypoint& k : keypoints) taps.push_back(MakeTap(k, stride, half_pixel, width, height));
  DescriptorMatrix descriptors(static_cast<Eigen::Index>(keypoints.size()), size);
  // One channel after the other: a channel of the map fits into the cache, the whole map does not.
  for (int channel = 0; channel < size; ++channel) {
    const float* plane = map.data + static_cast<std::ptrdiff_t>(channel) * width * height;
    float* out = descriptors.data() + channel;
    for (const BilinearTap& tap : taps) {
      const float* top = plane + tap.top;
      const float* bottom = plane + tap.bottom;
      *out = tap.w00 * top[0] + tap.w01 * top[tap.right] + tap.w10 * bottom[0] +
             tap.w11 * bottom[tap.right];
      out += size;
    }
  }
  for (Eigen::Index i = 0; i < descriptors.rows(); ++i) {
    const float norm = descriptors.row(i).norm();
    if (norm > 0) descriptors.row(i) /= norm;
  }
  return descriptors;
}

// The network, with or without the line module, compiled for one image size, and its input.
struct PlNet::Instance {
  cv::Size image_size;
  bool lines = false;
  int width = 0, height = 0;  // of the network's input
  std::unique_ptr<Network> network;
  std::vector<float> input;
};

PlNet::PlNet(const FeatureNetworkSpec& spec, NetworkLoader loader, const PlNetOptions& options)
    : spec_(spec), loader_(std::move(loader)), options_(options) {
  options_.decoder.score_threshold = spec_.score_threshold;
  options_.decoder.nms_radius = spec_.nms_radius;
  options_.decoder.Validate();
  if (spec_.lines) spec_.lines->decoder.Validate();
}

PlNet::~PlNet() = default;

PlNet::Instance& PlNet::InstanceFor(cv::Size image_size, bool lines) {
  const auto found = std::find_if(instances_.begin(), instances_.end(), [&](const auto& instance) {
    return instance->image_size == image_size && instance->lines == lines;
  });
  if (found != instances_.end()) {
    std::rotate(found, found + 1, instances_.end());
    return *instances_.back();
  }
  auto instance = std::make_unique<Instance>();
  instance->image_size = image_size;
  instance->lines = lines;
  instance->width = RoundUp(image_size.width, spec_.multiple);
  instance->height = RoundUp(image_size.height, spec_.multiple);
  instance->input.resize(static_cast<std::size_t>(instance->width) *
                         static_cast<std::size_t>(instance->height));
  const std::int64_t w = instance->width, h = instance->height, s = spec_.descriptor_stride;
  const PackFile& file = lines ? spec_.lines->network : spec_.network;
  instance->network = loader_(file.path, {{spec_.input, {1, 1, h, w}}});
  instance->network->RequireOutput(spec_.scores, {1, 1, h, w});
  instance->network->RequireOutput(spec_.descriptors, {1, spec_.descriptor_size, h / s, w / s});
  if (lines) LoadLineModule(*instance->network, h, w);
  if (instances_.size() == kMaxInstances) instances_.erase(instances_.begin());
  instances_.push_back(std::move(instance));
  return *instances_.back();
}

void PlNet::LoadLineModule(const Network& network, std::int64_t height, std::int64_t width) {
  const LineNetworkSpec& lines = *spec_.lines;
  const std::int64_t h = height / lines.decoder.stride, w = width / lines.decoder.stride;
  network.RequireOutput(lines.field, {1, 6, h, w});
  network.RequireOutput(lines.junctions, {1, 3, h, w});
  network.RequireOutput(lines.pooled, {1, h, w, lines.channels});
  if (classifier_) return;
  const TensorShape shape = {kClassifierRows, lines.samples * lines.channels + kLineExtras};
  classifier_ = loader_(lines.classifier.path, {{lines.classifier_input, shape}});
  classifier_->RequireOutput(lines.classifier_output, {shape[0]});
  classifier_input_.assign(static_cast<std::size_t>(ElementCount(shape)), 0.0F);
}

void PlNet::Prepare(cv::Size image_size, bool lines) {
  InstanceFor(image_size, lines && finds_lines());
}

// The probability of each proposal. Rows of the last run beyond the proposals keep what they held:
// no row of the classifier looks at another.
std::vector<float> PlNet::Classify(const Network& network, std::span<const Keypoint> junctions,
                                   std::span<const LineProposal> proposals) {
  const LineNetworkSpec& lines = *spec_.lines;
  const TensorView pooled = network.Output(lines.pooled);
  const auto height = static_cast<int>(pooled.shape[1]), width = static_cast<int>(pooled.shape[2]);
  const TensorShape shape = {kClassifierRows, lines.samples * lines.channels + kLineExtras};
  const NamedTensor input{lines.classifier_input, {classifier_input_.data(), shape}};
  std::vector<float> probabilities;
  probabilities.reserve(proposals.size());
  while (probabilities.size() < proposals.size()) {
    const auto part = proposals.subspan(
        probabilities.size(), std::min(kClassifierRows, proposals.size() - probabilities.size()));
    float* row = classifier_input_.data();
    for (const LineProposal& proposal : part) {
      PoolAlongLine(pooled.data, width, height, lines.channels, lines.decoder.stride,
                    junctions[static_cast<std::size_t>(proposal.start)],
                    junctions[static_cast<std::size_t>(proposal.end)], lines.samples, row);
      row = std::copy(proposal.extras.begin(), proposal.extras.end(),
                      row + static_cast<std::ptrdiff_t>(lines.samples) * lines.channels);
    }
    classifier_->Run({&input, 1});
    const float* logits = classifier_->Output(lines.classifier_output).data;
    std::transform(logits, logits + part.size(), std::back_inserter(probabilities),
                   [](float logit) { return 1 / (1 + std::exp(-logit)); });
  }
  return probabilities;
}

void PlNet::DetectLines(const Network& network, const cv::Mat& image, const cv::Mat& mask,
                        const DetectionRequest& request, Detections& detections) {
  const LineNetworkSpec& lines = *spec_.lines;
  LineDecoderOptions decoder = lines.decoder;
  decoder.max_junctions = std::min(decoder.max_junctions, request.max_junctions);
  decoder.max_proposals = std::min(decoder.max_proposals, request.max_line_proposals);
  decoder.Validate();
  const TensorView field = network.Output(lines.field);
  const LineMaps maps{field.data, network.Output(lines.junctions).data,
                      static_cast<int>(field.shape[3]), static_cast<int>(field.shape[2])};
  const std::vector<Keypoint> junctions = FindJunctions(maps, image.size(), mask, decoder);
  const std::vector<LineProposal> proposals = ProposeLines(maps, junctions, mask, decoder);
  const std::vector<float> scores =
      SuppressDoubles(junctions, proposals, Classify(network, junctions, proposals),
                      decoder.double_radius, request.min_line_score);
  KeepLines(junctions, proposals, scores, request.min_line_score, detections);
  detections.junction_descriptors =
      SampleDescriptors(network.Output(spec_.descriptors), detections.junctions,
                        spec_.descriptor_stride, spec_.half_pixel);
}

Detections PlNet::Detect(const cv::Mat& image, const cv::Mat& mask,
                         const DetectionRequest& request) {
  if (image.empty() || image.type() != CV_8UC1) {
    Fail("PLNet takes grey images of type CV_8UC1 with at least one pixel, not {}x{} of type {}",
         image.cols, image.rows, cv::typeToString(image.type()));
  }
  const bool lines = request.lines && finds_lines();
  Instance& instance = InstanceFor(image.size(), lines);
  NormalizeImage(image, spec_.normalization, instance.width, instance.height,
                 instance.input.data());
  const NamedTensor input{spec_.input,
                          {instance.input.data(), {1, 1, instance.height, instance.width}}};
  instance.network->Run({&input, 1});

  KeypointDecoderOptions decoder = options_.decoder;
  decoder.max_keypoints = request.max_keypoints;
  const TensorView scores = instance.network->Output(spec_.scores);
  Detections detections;
  detections.keypoints =
      DecodeKeypoints({scores.data, image.cols, image.rows, instance.width}, mask, decoder);
  detections.descriptors =
      SampleDescriptors(instance.network->Output(spec_.descriptors), detections.keypoints,
                        spec_.descriptor_stride, spec_.half_pixel);
  if (lines) DetectLines(*instance.network, image, mask, request, detections);
  return detections;
}

}  // namespace airslam
