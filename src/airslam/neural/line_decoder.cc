// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/neural/line_decoder.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <numeric>
#include <opencv2/imgproc.hpp>
#include <tuple>
#include <utility>

#include "airslam/common/error.h"

namespace airslam {
namespace {

constexpr float kHalfPi = std::numbers::pi_v<float> / 2;

float Sigmoid(float x) { return 1 / (1 + std::exp(-x)); }

float Logit(float probability) { return std::log(probability / (1 - probability)); }

float Distance(const Keypoint& p, const Keypoint& q) {
  return std::sqrt((p.x - q.x) * (p.x - q.x) + (p.y - q.y) * (p.y - q.y));
}

// Pixel of the centre of a cell.
float Centre(int cell, int stride) {
  return static_cast<float>(cell * stride) + static_cast<float>(stride - 1) / 2;
}

std::ptrdiff_t Plane(const LineMaps& maps) {
  return static_cast<std::ptrdiff_t>(maps.width) * maps.height;
}

// Pixels that lines keep away from: masked ones and those within `border` of them. Empty when
// nothing is masked.
cv::Mat Forbidden(const cv::Mat& mask, int border) {
  if (mask.empty()) return {};
  cv::Mat forbidden = mask == 0;
  if (border > 0) {
    const int side = 2 * border + 1;
    cv::dilate(forbidden, forbidden, cv::getStructuringElement(cv::MORPH_RECT, {side, side}));
  }
  return forbidden;
}

bool IsForbidden(const cv::Mat& forbidden, float x, float y) {
  if (forbidden.empty()) return false;
  const int column = std::clamp(static_cast<int>(std::lround(x)), 0, forbidden.cols - 1);
  const int row = std::clamp(static_cast<int>(std::lround(y)), 0, forbidden.rows - 1);
  return forbidden.at<std::uint8_t>(row, column) != 0;
}

// Share of a segment that lies on forbidden pixels, looked at every two pixels.
float ForbiddenShare(const cv::Mat& forbidden, const Keypoint& a, const Keypoint& b) {
  if (forbidden.empty()) return 0;
  const int steps = std::max(2, static_cast<int>(std::hypot(b.x - a.x, b.y - a.y) / 2));
  int count = 0;
  for (int i = 0; i <= steps; ++i) {
    const float t = static_cast<float>(i) / static_cast<float>(steps);
    count += IsForbidden(forbidden, a.x + t * (b.x - a.x), a.y + t * (b.y - a.y)) ? 1 : 0;
  }
  return static_cast<float>(count) / static_cast<float>(steps + 1);
}

// Finds the nearest of some points, if one is nearer than `radius`: points are sorted into square
// buckets of that side, and the nearest lies in one of the nine around.
class NearestJunction {
 public:
  NearestJunction(std::span<const Keypoint> points, float radius, int width, int height)
      : points_(points),
        radius_(radius),
        columns_(static_cast<int>(static_cast<float>(width) / radius) + 1),
        rows_(static_cast<int>(static_cast<float>(height) / radius) + 1),
        buckets_(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_)) {
    for (std::size_t i = 0; i < points.size(); ++i) {
      buckets_[Index(Row(points[i].y), Column(points[i].x))].push_back(static_cast<int>(i));
    }
  }

  // Index of the point (of equally near ones the first) and its distance; -1 when there is none.
  std::pair<int, float> Find(float x, float y) const {
    // Written so that not-a-number is far away, too.
    if (!(x > -radius_ && y > -radius_ && x < radius_ * static_cast<float>(columns_ + 1) &&
          y < radius_ * static_cast<float>(rows_ + 1))) {
      return {-1, 0.0F};
    }
    const int row = static_cast<int>(std::floor(y / radius_));
    const int column = static_cast<int>(std::floor(x / radius_));
    int best = -1;
    float best_squared = radius_ * radius_;
    for (int r = std::max(row - 1, 0); r <= std::min(row + 1, rows_ - 1); ++r) {
      for (int c = std::max(column - 1, 0); c <= std::min(column + 1, columns_ - 1); ++c) {
        for (const int i : buckets_[Index(r, c)]) {
          const Keypoint& p = points_[static_cast<std::size_t>(i)];
          const float squared = (p.x - x) * (p.x - x) + (p.y - y) * (p.y - y);
          if (squared < best_squared || (squared == best_squared && i < best)) {
            best = i;
            best_squared = squared;
          }
        }
      }
    }
    return {best, std::sqrt(best_squared)};
  }

 private:
  int Row(float y) const { return std::clamp(static_cast<int>(y / radius_), 0, rows_ - 1); }
  int Column(float x) const { return std::clamp(static_cast<int>(x / radius_), 0, columns_ - 1); }
  std::size_t Index(int row, int column) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) +
           static_cast<std::size_t>(column);
  }

  std::span<const Keypoint> points_;
  float radius_;
  int columns_, rows_;
  std::vector<std::vector<int>> buckets_;
};

// A cell's segment after snapping.
struct Vote {
  std::uint32_t key;  // first junction * number of junctions + second, the first the smaller
  float distance;     // of both ends to their junctions, summed
  float confidence;
};

std::vector<Vote> CollectVotes(const LineMaps& maps, std::span<const Keypoint> junctions,
                               const LineDecoderOptions& options) {
  const NearestJunction nearest(junctions, options.snap, maps.width * options.stride,
                                maps.height * options.stride);
  const float threshold = Logit(options.min_confidence);
  const auto count = static_cast<std::uint32_t>(junctions.size());
  std::vector<Vote> votes;
  for (int row = 0; row < maps.height; ++row) {
    const float* logits = maps.field + static_cast<std::ptrdiff_t>(row) * maps.width;
    for (int column = 0; column < maps.width; ++column) {
      if (!(logits[column] > threshold)) continue;
      const std::array<float, 4> line = DecodeLine(maps, options, row, column);
      const auto [first, distance1] = nearest.Find(line[0], line[1]);
      if (first < 0) continue;
      const auto [second, distance2] = nearest.Find(line[2], line[3]);
      if (second < 0 || second == first) continue;
      const auto low = static_cast<std::uint32_t>(std::min(first, second));
      const auto high = static_cast<std::uint32_t>(std::max(first, second));
      votes.push_back({low * count + high, distance1 + distance2, Sigmoid(logits[column])});
    }
  }
  return votes;
}

// Samples along a line, in sixteenths and a half. The middle comes first: near its ends other lines
// of the junctions may agree, so that what is no line shows there last.
constexpr std::array<int, 16> kSupportOrder = {8, 4, 12, 6, 10, 2, 14, 7,
                                               9, 5, 11, 3, 13, 1, 0,  15};
constexpr int kSupportSamples = static_cast<int>(kSupportOrder.size());
constexpr float kSupportOffset = 5;    // pixels
constexpr float kSupportDistance = 4;  // pixels
constexpr float kSupportCosine = 0.85F;
constexpr float kSupportConfidence = 0.2F;

// The line that each cell sees: its foot on it and its direction there.
class SeenLines {
 public:
  SeenLines(const LineMaps& maps, const LineDecoderOptions& options)
      : width_(maps.width),
        height_(maps.height),
        offset_(Centre(0, options.stride)),
        per_stride_(1 / static_cast<float>(options.stride)) {
    const std::ptrdiff_t plane = Plane(maps);
    const float threshold = Logit(kSupportConfidence);
    cells_.resize(static_cast<std::size_t>(plane));
    for (std::ptrdiff_t i = 0; i < plane; ++i) {
      const float* cell = maps.field + i;
      if (!(*cell > threshold)) continue;
      const float b = cell[2 * plane], c = cell[3 * plane];
      const float norm = std::max(std::sqrt(b * b + c * c), 1e-6F);
      const float d = options.reach * Sigmoid(cell[plane]);
      Seen& seen = cells_[static_cast<std::size_t>(i)];
      seen.cosine = b / norm;
      seen.sine = c / norm;
      seen.x = Centre(static_cast<int>(i % maps.width), options.stride) + d * seen.cosine;
      seen.y = Centre(static_cast<int>(i / maps.width), options.stride) + d * seen.sine;
    }
  }

  // Share of the samples between two junctions that agree; stops where fewer than `least` can.
  float Support(const Keypoint& p, const Keypoint& q, float least) const {
    const float length = Distance(p, q);
    if (!(length > 0)) return 0;
    const Line line{p.x, p.y, (p.y - q.y) / length, (q.x - p.x) / length};
    int agree = 0;
    for (int i = 0; i < kSupportSamples; ++i) {
      const auto place = static_cast<float>(kSupportOrder[static_cast<std::size_t>(i)]);
      const float t = (place + 0.5F) / kSupportSamples;
      const float x = p.x + t * (q.x - p.x), y = p.y + t * (q.y - p.y);
      agree += Agrees(line, x, y, -kSupportOffset) | Agrees(line, x, y, kSupportOffset);
      if (static_cast<float>(agree + kSupportSamples - 1 - i) < least * kSupportSamples) return 0;
    }
    return static_cast<float>(agree) / kSupportSamples;
  }

 private:
  // Cosine and sine of 0 mark a cell that sees no line.
  struct Seen {
    float x = 0, y = 0, cosine = 0, sine = 0;
  };
  struct Line {
    float x, y, normal_x, normal_y;
  };

  // 1 or 0, without a branch: which it will be cannot be foreseen.
  int Agrees(const Line& line, float x, float y, float side) const {
    const auto cell = [this](float pixel, int size) {
      const float c = (pixel - offset_) * per_stride_ + 0.5F;  // rounded down: the nearest cell
      return std::min(static_cast<int>(std::max(c, 0.0F)), size - 1);
    };
    const int column = cell(x + side * line.normal_x, width_);
    const int row = cell(y + side * line.normal_y, height_);
    const Seen& seen = cells_[static_cast<std::size_t>(row) * static_cast<std::size_t>(width_) +
                              static_cast<std::size_t>(column)];
    const float distance = (seen.x - line.x) * line.normal_x + (seen.y - line.y) * line.normal_y;
    const float along = seen.cosine * line.normal_x + seen.sine * line.normal_y;
    return static_cast<int>(std::abs(distance) < kSupportDistance) &
           static_cast<int>(std::abs(along) > kSupportCosine);
  }

  int width_, height_;
  float offset_, per_stride_;  // of cells: their first centre, and cells a pixel
  std::vector<Seen> cells_;
};

// What speaks for one pair of junctions.
struct Candidate {
  int first = 0, second = 0;  // first < second
  int votes = 0;
  float nearest = 0;     // the least distance of a vote
  float confidence = 0;  // of the votes, summed
  float support = 0;
  float rank = 0;
};

// Pairs with votes, in the order of their keys.
std::vector<Candidate> CountVotes(std::vector<Vote> votes, int junctions) {
  // Stable, so that sums are taken in the order of the cells.
  std::stable_sort(votes.begin(), votes.end(),
                   [](const Vote& a, const Vote& b) { return a.key < b.key; });
  std::vector<Candidate> counted;
  std::uint32_t key = 0;
  for (const Vote& vote : votes) {
    if (counted.empty() || vote.key != key) {
      key = vote.key;
      const auto first = static_cast<int>(key / static_cast<std::uint32_t>(junctions));
      const auto second = static_cast<int>(key % static_cast<std::uint32_t>(junctions));
      counted.push_back({.first = first, .second = second, .nearest = vote.distance});
    }
    ++counted.back().votes;
    counted.back().nearest = std::min(counted.back().nearest, vote.distance);
    counted.back().confidence += vote.confidence;
  }
  return counted;
}

// All pairs with votes or with support, best first, ties by junction indices.
std::vector<Candidate> CollectCandidates(const LineMaps& maps, std::span<const Keypoint> junctions,
                                         const LineDecoderOptions& options) {
  const auto count = static_cast<int>(junctions.size());
  const std::vector<Candidate> voted = CountVotes(CollectVotes(maps, junctions, options), count);
  const SeenLines seen(maps, options);
  std::vector<Candidate> candidates;
  auto next = voted.begin();
  for (int i = 0; i < count; ++i) {
    const Keypoint& p = junctions[static_cast<std::size_t>(i)];
    for (int j = i + 1; j < count; ++j) {
      const Keypoint& q = junctions[static_cast<std::size_t>(j)];
      const bool has_votes = next != voted.end() && next->first == i && next->second == j;
      Candidate candidate{.first = i, .second = j, .nearest = 2 * options.snap};
      if (has_votes) candidate = *next++;
      candidate.support = seen.Support(p, q, has_votes ? 0 : options.min_support);
      if (!has_votes && !(candidate.support >= options.min_support)) continue;
      const float cells = Distance(p, q) / static_cast<float>(options.stride) + 1;
      candidate.rank = p.score * q.score *
                       (candidate.support + std::min(candidate.confidence / cells, 2.0F) / 2);
      candidates.push_back(candidate);
    }
  }
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return a.rank > b.rank; });
  return candidates;
}

std::array<float, kLineExtras> Extras(const Candidate& candidate, const Keypoint& start,
                                      const Keypoint& end, const LineDecoderOptions& options) {
  const auto votes = static_cast<float>(candidate.votes);
  const float length = std::hypot(end.x - start.x, end.y - start.y);
  const float dense = votes / (length / static_cast<float>(options.stride) + 1);
  return {std::log1p(votes) / 4,
          std::min(dense, 8.0F) / 4,
          candidate.nearest / options.snap,
          candidate.confidence / std::max(votes, 1.0F),
          start.score,
          end.score,
          length / 256,
          std::log(length + 1) / 4,
          candidate.support};
}

bool IsPeak(const LineMaps& maps, int row, int column) {
  const float value = maps.junctions[static_cast<std::ptrdiff_t>(row) * maps.width + column];
  for (int r = std::max(row - 1, 0); r <= std::min(row + 1, maps.height - 1); ++r) {
    for (int c = std::max(column - 1, 0); c <= std::min(column + 1, maps.width - 1); ++c) {
      if (maps.junctions[static_cast<std::ptrdiff_t>(r) * maps.width + c] > value) return false;
    }
  }
  return true;
}

}  // namespace

void LineDecoderOptions::Validate() const {
  const auto check = [](bool good, const char* field, double value, const char* expected) {
    if (!good) Fail("LineDecoderOptions.{} is {}, expected {}", field, value, expected);
  };
  check(stride >= 1 && stride <= 64, "stride", stride, "1 to 64");
  check(reach > 0 && std::isfinite(reach), "reach", reach, "a positive number");
  check(min_confidence > 0 && min_confidence < 1, "min_confidence", min_confidence,
        "a number between 0 and 1");
  check(min_junction > 0 && min_junction < 1, "min_junction", min_junction,
        "a number between 0 and 1");
  check(max_junctions >= 2 && max_junctions <= 65535, "max_junctions", max_junctions, "2 to 65535");
  check(snap > 0 && std::isfinite(snap), "snap", snap, "a positive number");
  check(min_support > 0 && min_support <= 1, "min_support", min_support, "more than 0, at most 1");
  check(max_proposals >= 1, "max_proposals", max_proposals, "at least 1");
  check(double_radius >= 0 && std::isfinite(double_radius), "double_radius", double_radius,
        "a number of at least 0");
  check(mask_border >= 0, "mask_border", mask_border, "at least 0");
  check(max_masked >= 0 && max_masked <= 1, "max_masked", max_masked, "0 to 1");
}

std::array<float, 4> DecodeLine(const LineMaps& maps, const LineDecoderOptions& options, int row,
                                int column) {
  const std::ptrdiff_t plane = Plane(maps);
  const float* cell = maps.field + static_cast<std::ptrdiff_t>(row) * maps.width + column;
  const float a = cell[plane], b = cell[2 * plane], c = cell[3 * plane];
  const float d = options.reach * Sigmoid(a);
  const float norm = std::max(std::sqrt(b * b + c * c), 1e-6F);
  const float cosine = b / norm, sine = c / norm;
  const float tangent1 = std::tan(kHalfPi * Sigmoid(cell[4 * plane]));
  const float tangent2 = -std::tan(kHalfPi * Sigmoid(cell[5 * plane]));
  const float x = Centre(column, options.stride), y = Centre(row, options.stride);
  return {x + d * (cosine - sine * tangent1), y + d * (sine + cosine * tangent1),
          x + d * (cosine - sine * tangent2), y + d * (sine + cosine * tangent2)};
}

std::vector<Keypoint> FindJunctions(const LineMaps& maps, cv::Size image_size, const cv::Mat& mask,
                                    const LineDecoderOptions& options) {
  const cv::Mat forbidden = Forbidden(mask, options.mask_border);
  const float threshold = Logit(options.min_junction);
  const std::ptrdiff_t plane = Plane(maps);
  const auto stride = static_cast<float>(options.stride);
  std::vector<Keypoint> junctions;
  for (int row = 0; row < maps.height; ++row) {
    for (int column = 0; column < maps.width; ++column) {
      const float* cell = maps.junctions + static_cast<std::ptrdiff_t>(row) * maps.width + column;
      if (!(*cell > threshold) || !IsPeak(maps, row, column)) continue;
      Keypoint junction;
      junction.x =
          std::clamp(Centre(column, options.stride) + stride * 0.5F * std::tanh(cell[plane]), 0.0F,
                     static_cast<float>(image_size.width - 1));
      junction.y =
          std::clamp(Centre(row, options.stride) + stride * 0.5F * std::tanh(cell[2 * plane]), 0.0F,
                     static_cast<float>(image_size.height - 1));
      junction.score = Sigmoid(*cell);
      if (!IsForbidden(forbidden, junction.x, junction.y)) junctions.push_back(junction);
    }
  }
  std::stable_sort(junctions.begin(), junctions.end(),
                   [](const Keypoint& a, const Keypoint& b) { return a.score > b.score; });
  junctions.resize(std::min(junctions.size(), static_cast<std::size_t>(options.max_junctions)));
  return junctions;
}

float LineSupport(const LineMaps& maps, const Keypoint& start, const Keypoint& end,
                  const LineDecoderOptions& options) {
  return SeenLines(maps, options).Support(start, end, 0);
}

std::vector<LineProposal> ProposeLines(const LineMaps& maps, std::span<const Keypoint> junctions,
                                       const cv::Mat& mask, const LineDecoderOptions& options) {
  const cv::Mat forbidden = Forbidden(mask, options.mask_border);
  std::vector<LineProposal> proposals;
  for (const Candidate& candidate : CollectCandidates(maps, junctions, options)) {
    if (proposals.size() == static_cast<std::size_t>(options.max_proposals)) break;
    LineProposal proposal;
    proposal.start = candidate.first;
    proposal.end = candidate.second;
    const Keypoint* start = &junctions[static_cast<std::size_t>(proposal.start)];
    const Keypoint* end = &junctions[static_cast<std::size_t>(proposal.end)];
    if (ForbiddenShare(forbidden, *start, *end) > options.max_masked) continue;
    if (start->x > end->x) {
      std::swap(start, end);
      std::swap(proposal.start, proposal.end);
    }
    proposal.extras = Extras(candidate, *start, *end, options);
    proposals.push_back(proposal);
  }
  return proposals;
}

std::vector<float> SuppressDoubles(std::span<const Keypoint> junctions,
                                   std::span<const LineProposal> proposals,
                                   std::span<const float> scores, float radius, float min_score) {
  std::vector<std::size_t> order(proposals.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return scores[a] > scores[b]; });
  const auto squared = [&](int i, int j) {
    const Keypoint& p = junctions[static_cast<std::size_t>(i)];
    const Keypoint& q = junctions[static_cast<std::size_t>(j)];
    return (p.x - q.x) * (p.x - q.x) + (p.y - q.y) * (p.y - q.y);
  };
  std::vector<float> result(proposals.size(), -1.0F);
  std::vector<std::size_t> kept;
  for (const std::size_t i : order) {
    if (!(scores[i] >= min_score)) break;
    const LineProposal& a = proposals[i];
    const bool is_double = std::any_of(kept.begin(), kept.end(), [&](std::size_t k) {
      const LineProposal& b = proposals[k];
      return std::min(squared(a.start, b.start) + squared(a.end, b.end),
                      squared(a.start, b.end) + squared(a.end, b.start)) < radius * radius;
    });
    if (is_double) continue;
    kept.push_back(i);
    result[i] = scores[i];
  }
  return result;
}

void KeepLines(std::span<const Keypoint> junctions, std::span<const LineProposal> proposals,
               std::span<const float> scores, float min_score, Detections& detections) {
  std::vector<std::size_t> kept;
  std::vector<int> index(junctions.size(), -1);  // of a junction among those kept
  for (std::size_t i = 0; i < proposals.size(); ++i) {
    if (!(scores[i] >= min_score)) continue;
    kept.push_back(i);
    index[static_cast<std::size_t>(proposals[i].start)] = 0;
    index[static_cast<std::size_t>(proposals[i].end)] = 0;
  }
  std::sort(kept.begin(), kept.end(), [&](std::size_t a, std::size_t b) {
    return std::tuple(-scores[a], proposals[a].start, proposals[a].end) <
           std::tuple(-scores[b], proposals[b].start, proposals[b].end);
  });
  for (std::size_t i = 0; i < junctions.size(); ++i) {
    if (index[i] < 0) continue;
    index[i] = static_cast<int>(detections.junctions.size());
    detections.junctions.push_back(junctions[i]);
  }
  for (const std::size_t i : kept) {
    const LineEnds ends{index[static_cast<std::size_t>(proposals[i].start)],
                        index[static_cast<std::size_t>(proposals[i].end)]};
    const Keypoint& start = detections.junctions[static_cast<std::size_t>(ends.start)];
    const Keypoint& end = detections.junctions[static_cast<std::size_t>(ends.end)];
    detections.lines.push_back({start.x, start.y, end.x, end.y, scores[i]});
    detections.line_ends.push_back(ends);
  }
}

void PoolAlongLine(const float* map, int width, int height, int channels, int stride,
                   const Keypoint& start, const Keypoint& end, int samples, float* out) {
  const auto cell = [stride](float pixel, int size) {
    const float c = (pixel + 0.5F) / static_cast<float>(stride) - 0.5F;
    return std::clamp(c, 0.0F, static_cast<float>(size - 1));
  };
  for (int i = 0; i < samples; ++i, out += channels) {
    const float t = static_cast<float>(i) / static_cast<float>(samples - 1);
    const float x = cell(start.x + t * (end.x - start.x), width);
    const float y = cell(start.y + t * (end.y - start.y), height);
    const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
    const float ax = x - static_cast<float>(x0), ay = y - static_cast<float>(y0);
    const std::ptrdiff_t right = x0 + 1 < width ? channels : 0;
    const std::ptrdiff_t below =
        y0 + 1 < height ? static_cast<std::ptrdiff_t>(width) * channels : 0;
    const float* top = map + (static_cast<std::ptrdiff_t>(y0) * width + x0) * channels;
    const float* bottom = top + below;
    for (int k = 0; k < channels; ++k) {
      out[k] = (1 - ay) * ((1 - ax) * top[k] + ax * top[right + k]) +
               ay * ((1 - ax) * bottom[k] + ax * bottom[right + k]);
    }
  }
}

}  // namespace airslam
