// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/neural/plnet.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <numeric>
#include <string>
#include <utility>

#include "airslam/common/error.h"

namespace airslam {
namespace {

// A stereo pair needs one size, a folder of pictures perhaps a few.
constexpr std::size_t kMaxInstances = 4;

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

// What is compiled and allocated for one image size.
struct PlNet::Instance {
  cv::Size image_size;
  int width = 0, height = 0;  // of the network's input
  std::vector<float> input, scores;
  std::vector<int> map_sizes;         // values of each map
  std::unique_ptr<Network> features;  // scores and maps; loaded by the first image to see
  std::unique_ptr<Network> lines;     // loaded by the first image with lines
};

PlNet::PlNet(const FeatureNetworkSpec& spec, NetworkLoader loader, const PlNetOptions& options)
    : spec_(spec), loader_(std::move(loader)), options_(options) {
  options_.decoder.score_threshold = spec_.score_threshold;
  options_.decoder.nms_radius = spec_.nms_radius;
  options_.decoder.Validate();
  if (spec_.lines) spec_.lines->decoder.Validate();
}

PlNet::~PlNet() = default;

PlNet::Instance& PlNet::InstanceFor(cv::Size image_size) {
  const auto found = std::find_if(instances_.begin(), instances_.end(), [&](const auto& instance) {
    return instance->image_size == image_size;
  });
  if (found != instances_.end()) {
    std::rotate(found, found + 1, instances_.end());
    return *instances_.back();
  }
  auto instance = std::make_unique<Instance>();
  instance->image_size = image_size;
  instance->width = RoundUp(image_size.width, spec_.multiple);
  instance->height = RoundUp(image_size.height, spec_.multiple);
  for (const FeatureMapSpec& map : spec_.maps) {
    instance->map_sizes.push_back(instance->width / map.stride * (instance->height / map.stride) *
                                  map.channels);
  }
  if (instances_.size() == kMaxInstances) instances_.erase(instances_.begin());
  instances_.push_back(std::move(instance));
  return *instances_.back();
}

void PlNet::LoadFeatures(Instance& instance) {
  const std::int64_t w = instance.width, h = instance.height, s = spec_.score_stride;
  auto network = loader_(spec_.network.path, {{spec_.input, {1, 1, h, w}}});
  network->RequireOutput(spec_.scores,
                         s == 1 ? TensorShape{1, 1, h, w} : TensorShape{h / s * (w / s), s * s});
  for (const FeatureMapSpec& map : spec_.maps) {
    const std::int64_t rows = h / map.stride, columns = w / map.stride;
    network->RequireOutput(map.output, spec_.layout == MapLayout::kCells
                                           ? TensorShape{rows * columns, map.channels}
                                           : TensorShape{1, map.channels, rows, columns});
  }
  LoadDescriptorHead();
  instance.input.resize(static_cast<std::size_t>(w * h));
  if (s > 1) instance.scores.resize(static_cast<std::size_t>(w * h));
  instance.features = std::move(network);
}

void PlNet::LoadDescriptorHead() {
  if (!spec_.descriptor_head || descriptor_head_) return;
  descriptor_head_ = std::make_unique<RowNetwork>(*spec_.descriptor_head, SampledChannels(),
                                                  spec_.descriptor_size, loader_);
}

int PlNet::SampledChannels() const {
  return std::accumulate(spec_.maps.begin(), spec_.maps.end(), 0,
                         [](int sum, const FeatureMapSpec& map) { return sum + map.channels; });
}

void PlNet::LoadLines(Instance& instance) {
  const LineNetworkSpec& lines = *spec_.lines;
  const std::int64_t w = instance.width, h = instance.height, s = lines.decoder.stride;
  std::map<std::string, TensorShape> shapes;
  for (const FeatureMapSpec& map : spec_.maps) {
    shapes[map.output] = {1, h / map.stride, w / map.stride, map.channels};
  }
  auto network = loader_(lines.network.path, shapes);
  network->RequireOutput(lines.field, {1, 6, h / s, w / s});
  network->RequireOutput(lines.junctions, {1, 3, h / s, w / s});
  int inputs = kLineExtras;
  for (const auto& [map, samples, end_offsets] : lines.pooled) {
    network->RequireOutput(map.output, {h / map.stride * (w / map.stride), map.channels});
    inputs += (samples + 2 * static_cast<int>(end_offsets.size())) * map.channels;
  }
  if (!classifier_) {
    classifier_ = std::make_unique<RowNetwork>(lines.classifier, inputs, 1, loader_);
  }
  LoadDescriptorHead();
  instance.lines = std::move(network);
}

PlNet::Instance& PlNet::WithFeatures(cv::Size image_size) {
  Instance& instance = InstanceFor(image_size);
  if (!instance.features) LoadFeatures(instance);
  return instance;
}

PlNet::Instance& PlNet::WithLines(cv::Size image_size) {
  Instance& instance = InstanceFor(image_size);
  if (!instance.lines) LoadLines(instance);
  return instance;
}

FeatureMap PlNet::MapOf(const ImageMaps& maps, std::size_t index) const {
  const FeatureMapSpec& map = spec_.maps[index];
  return {maps.values[index].ptr<float>(),
          RoundUp(maps.image_size.width, spec_.multiple) / map.stride,
          RoundUp(maps.image_size.height, spec_.multiple) / map.stride,
          map.channels,
          map.stride,
          spec_.layout};
}

// The scores are those of the instance's latest run.
std::vector<Keypoint> PlNet::FindKeypoints(Instance& instance, const cv::Mat& mask,
                                           int count) const {
  const int s = spec_.score_stride;
  const float* plane = instance.features->Output(spec_.scores).data;
  if (s > 1) {
    UnfoldCells({plane, instance.width / s, instance.height / s, s * s, s}, instance.scores.data());
    plane = instance.scores.data();
  }
  KeypointDecoderOptions decoder = options_.decoder;
  decoder.max_keypoints = count;
  const cv::Size size = instance.image_size;
  return DecodeKeypoints({plane, size.width, size.height, instance.width}, mask, decoder);
}

DescriptorMatrix PlNet::Describe(const ImageMaps& maps, std::span<const Keypoint> points) {
  const int channels = SampledChannels();
  DescriptorMatrix samples(static_cast<Eigen::Index>(points.size()), channels);
  int first = 0;
  for (std::size_t i = 0; i < spec_.maps.size(); ++i) {
    SampleAtKeypoints(MapOf(maps, i), points, spec_.half_pixel, samples.data() + first, channels);
    first += spec_.maps[i].channels;
  }
  if (descriptor_head_) {
    const std::vector<float> described = descriptor_head_->Run(
        static_cast<int>(points.size()),
        [&](int i, float* row) { std::copy_n(samples.row(i).data(), channels, row); });
    samples =
        Eigen::Map<const DescriptorMatrix>(described.data(), samples.rows(), spec_.descriptor_size);
  }
  for (Eigen::Index i = 0; i < samples.rows(); ++i) {
    const float norm = samples.row(i).norm();
    if (norm > 0) samples.row(i) /= norm;
  }
  return samples;
}

// The probability of each proposal.
std::vector<float> PlNet::Classify(const Instance& instance, std::span<const Keypoint> junctions,
                                   std::span<const LineProposal> proposals) {
  std::vector<FeatureMap> maps;
  for (const PooledMapSpec& pooled : spec_.lines->pooled) {
    const FeatureMapSpec& map = pooled.map;
    maps.push_back({instance.lines->Output(map.output).data, instance.width / map.stride,
                    instance.height / map.stride, map.channels, map.stride});
  }
  const auto fill = [&](int index, float* row) {
    const LineProposal& proposal = proposals[static_cast<std::size_t>(index)];
    const Keypoint& start = junctions[static_cast<std::size_t>(proposal.start)];
    const Keypoint& end = junctions[static_cast<std::size_t>(proposal.end)];
    for (std::size_t i = 0; i < maps.size(); ++i) {
      const int samples = spec_.lines->pooled[i].samples;
      PoolAlongLine(maps[i], start, end, samples, row);
      row += static_cast<std::ptrdiff_t>(samples) * maps[i].channels;
    }
    row = std::copy(proposal.extras.begin(), proposal.extras.end(), row);
    for (std::size_t i = 0; i < maps.size(); ++i) {
      const std::vector<float>& offsets = spec_.lines->pooled[i].end_offsets;
      const std::ptrdiff_t size = std::ssize(offsets) * maps[i].channels;
      PoolAtEnd(maps[i], start, end, offsets, row);
      PoolAtEnd(maps[i], end, start, offsets, row + size);
      row += 2 * size;
    }
  };
  std::vector<float> scores = classifier_->Run(static_cast<int>(proposals.size()), fill);
  for (float& score : scores) score = 1 / (1 + std::exp(-score));
  return scores;
}

void PlNet::AddLines(const ImageMaps& maps, const cv::Mat& mask, const DetectionRequest& request,
                     Detections& detections) {
  const LineNetworkSpec& lines = *spec_.lines;
  LineDecoderOptions decoder = lines.decoder;
  decoder.max_junctions = std::min(decoder.max_junctions, request.max_junctions);
  decoder.max_proposals = std::min(decoder.max_proposals, request.max_line_proposals);
  decoder.Validate();
  Instance& instance = WithLines(maps.image_size);
  std::vector<NamedTensor> inputs;
  for (std::size_t i = 0; i < spec_.maps.size(); ++i) {
    const FeatureMap map = MapOf(maps, i);
    inputs.push_back({spec_.maps[i].output, {map.data, {1, map.height, map.width, map.channels}}});
  }
  instance.lines->Run(inputs);
  const TensorView field = instance.lines->Output(lines.field);
  const LineMaps line_maps{field.data, instance.lines->Output(lines.junctions).data,
                           static_cast<int>(field.shape[3]), static_cast<int>(field.shape[2])};
  const std::vector<Keypoint> junctions = FindJunctions(line_maps, maps.image_size, mask, decoder);
  const std::vector<LineProposal> proposals = ProposeLines(line_maps, junctions, mask, decoder);
  const std::vector<float> single =
      SuppressDoubles(junctions, proposals, Classify(instance, junctions, proposals),
                      decoder.double_radius, request.min_line_score);
  const std::vector<float> scores =
      DiscountOverlaps(junctions, proposals, single, decoder.overlap_radius);
  KeepLines(junctions, proposals, scores, request.min_line_score, detections);
  detections.junction_descriptors = Describe(maps, detections.junctions);
}

Detections PlNet::Detect(const cv::Mat& image, const cv::Mat& mask,
                         const DetectionRequest& request) {
  if (image.empty() || image.type() != CV_8UC1) {
    Fail("PLNet takes grey images of type CV_8UC1 with at least one pixel, not {}x{} of type {}",
         image.cols, image.rows, cv::typeToString(image.type()));
  }
  Instance& instance = WithFeatures(image.size());
  NormalizeImage(image, spec_.normalization, instance.width, instance.height,
                 instance.input.data());
  const std::shared_ptr<ImageMaps> maps = pool_.Take(image.size(), instance.map_sizes);
  const NamedTensor input{spec_.input,
                          {instance.input.data(), {1, 1, instance.height, instance.width}}};
  std::vector<NamedBuffer> outputs;
  for (std::size_t i = 0; i < spec_.maps.size(); ++i) {
    outputs.push_back(
        {spec_.maps[i].output, {maps->values[i].ptr<float>(), maps->values[i].total()}});
  }
  instance.features->Run({&input, 1}, outputs);

  Detections detections;
  detections.keypoints = FindKeypoints(instance, mask, request.max_keypoints);
  detections.descriptors = Describe(*maps, detections.keypoints);
  if (request.lines && finds_lines()) AddLines(*maps, mask, request, detections);
  if (request.keep_maps) detections.maps = maps;
  return detections;
}

Detections PlNet::FindLines(const cv::Mat& image, const cv::Mat& mask, const Detections& seen,
                            DetectionRequest request) {
  if (!seen.maps) return FeatureDetector::FindLines(image, mask, seen, request);
  if (seen.maps->image_size != image.size() || seen.maps->values.size() != spec_.maps.size()) {
    Fail("lines cannot be looked for in maps of another image or of other networks");
  }
  Detections detections;
  if (request.lines && finds_lines()) AddLines(*seen.maps, mask, request, detections);
  return detections;
}

}  // namespace airslam
