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
#include "airslam/neural/line_cells.h"
#include "airslam/neural/line_support.h"

namespace airslam {
namespace {

constexpr float kHalfPi = std::numbers::pi_v<float> / 2;

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

// Finds the nearest of some points, if one is nearer than `radius`: each square bucket of the
// image, and of what is around it, lists all points that can be.
class NearestJunction {
 public:
  NearestJunction(std::span<const Keypoint> points, float radius, int width, int height)
      : radius_(radius),
        side_(std::max(radius / 2, 4.0F)),
        columns_(Place(static_cast<float>(width) + radius) + 1),
        rows_(Place(static_cast<float>(height) + radius) + 1),
        begin_(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_) + 1, 0) {
    for (const Keypoint& p : points) {
      VisitBuckets(p, [this](std::size_t bucket) { ++begin_[bucket + 1]; });
    }
    std::partial_sum(begin_.begin(), begin_.end(), begin_.begin());
    listed_.resize(begin_.back());
    std::vector<std::uint32_t> end(begin_.begin(), begin_.end() - 1);
    for (std::size_t i = 0; i < points.size(); ++i) {
      VisitBuckets(points[i], [&](std::size_t bucket) {
        listed_[end[bucket]++] = {points[i].x, points[i].y, static_cast<int>(i)};
      });
    }
  }

  // Index of the point (of equally near ones the first) and its distance; -1 when there is none.
  std::pair<int, float> Find(float x, float y) const {
    // Written so that not-a-number is far away, too.
    if (!(x > -radius_ && y > -radius_)) return {-1, 0.0F};
    const int column = Place(std::min(x, 1e9F)), row = Place(std::min(y, 1e9F));
    if (column >= columns_ || row >= rows_) return {-1, 0.0F};
    const std::size_t bucket = Index(row, column);
    int best = -1;
    float best_squared = radius_ * radius_;
    for (std::uint32_t k = begin_[bucket]; k < begin_[bucket + 1]; ++k) {
      const Listed& p = listed_[k];
      const float squared = (p.x - x) * (p.x - x) + (p.y - y) * (p.y - y);
      best = squared < best_squared ? p.index : best;
      best_squared = std::min(best_squared, squared);
    }
    return {best, std::sqrt(best_squared)};
  }

 private:
  struct Listed {
    float x, y;
    int index;
  };

  // Bucket of a coordinate of at least -radius; the first begins there.
  int Place(float pixel) const { return static_cast<int>((pixel + radius_) / side_); }
  std::size_t Index(int row, int column) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) +
           static_cast<std::size_t>(column);
  }

  // All buckets that hold a place within the radius of a point, give or take rounding.
  template <typename Visitor>
  void VisitBuckets(const Keypoint& p, Visitor&& visit) const {
    const float reach = 1.001F * radius_;
    const int first_column = Place(std::max(p.x - reach, -radius_));
    const int first_row = Place(std::max(p.y - reach, -radius_));
    const int last_column = std::min(Place(p.x + reach), columns_ - 1);
    const int last_row = std::min(Place(p.y + reach), rows_ - 1);
    for (int row = first_row; row <= last_row; ++row) {
      for (int column = first_column; column <= last_column; ++column) visit(Index(row, column));
    }
  }

  float radius_, side_;
  int columns_, rows_;
  std::vector<std::uint32_t> begin_;  // of each bucket's list, and the end of the last
  std::vector<Listed> listed_;        // in the order of the points in each bucket
};

// A cell's segment after snapping.
struct Vote {
  int first, second;  // junctions, first < second
  float distance;     // of both ends to their junctions, summed
  float confidence;
};

std::vector<Vote> CollectVotes(const LineMaps& maps, std::span<const Keypoint> junctions,
                               const LineDecoderOptions& options) {
  const NearestJunction nearest(junctions, options.snap, maps.width * options.stride,
                                maps.height * options.stride);
  const float threshold = Logit(options.min_confidence);
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
      votes.push_back({std::min(first, second), std::max(first, second), distance1 + distance2,
                       Sigmoid(logits[column])});
    }
  }
  return votes;
}

// What speaks for one pair of junctions.
struct Candidate {
  int first = 0, second = 0;  // first < second
  int votes = 0;
  float nearest = 0;     // the least distance of a vote
  float confidence = 0;  // of the votes, summed
  float support = 0;
  float rank = 0;
};

// The votes for pairs of each junction with later ones, in the order of the cells.
class VotesByJunction {
 public:
  VotesByJunction(std::span<const Vote> votes, std::size_t junctions)
      : begin_(junctions + 1, 0), votes_(votes.size()) {
    for (const Vote& vote : votes) ++begin_[static_cast<std::size_t>(vote.first) + 1];
    std::partial_sum(begin_.begin(), begin_.end(), begin_.begin());
    std::vector<std::size_t> end(begin_.begin(), begin_.end() - 1);
    for (const Vote& vote : votes) votes_[end[static_cast<std::size_t>(vote.first)]++] = vote;
  }

  std::span<const Vote> Of(std::size_t first) const {
    return std::span(votes_).subspan(begin_[first], begin_[first + 1] - begin_[first]);
  }

 private:
  std::vector<std::size_t> begin_;  // of each junction's votes, and the end of the last's
  std::vector<Vote> votes_;
};

// Sums up the votes of one junction; pairs[second] is that with the junction `second`.
void CountVotes(std::span<const Vote> votes, std::span<Candidate> pairs) {
  for (const Vote& vote : votes) {
    Candidate& pair = pairs[static_cast<std::size_t>(vote.second)];
    pair.nearest = pair.votes == 0 ? vote.distance : std::min(pair.nearest, vote.distance);
    pair.confidence += vote.confidence;
    ++pair.votes;
  }
}

// All pairs with votes or with support, best first, ties by junction indices.
std::vector<Candidate> CollectCandidates(const LineMaps& maps, std::span<const Keypoint> junctions,
                                         const LineDecoderOptions& options) {
  const VotesByJunction votes(CollectVotes(maps, junctions, options), junctions.size());
  const SeenLines seen(maps, options);
  std::vector<std::uint8_t> possible(junctions.size());
  std::vector<Candidate> pairs(junctions.size(), Candidate{.nearest = 2 * options.snap});
  std::vector<Candidate> candidates;
  for (std::size_t i = 0; i < junctions.size(); ++i) {
    const Keypoint& p = junctions[i];
    seen.FindPossible(p, junctions.subspan(i + 1), options.min_support,
                      std::span(possible).subspan(i + 1));
    CountVotes(votes.Of(i), pairs);
    for (std::size_t j = i + 1; j < junctions.size(); ++j) {
      if (pairs[j].votes == 0 && possible[j] == 0) continue;
      const Keypoint& q = junctions[j];
      Candidate candidate = std::exchange(pairs[j], Candidate{.nearest = 2 * options.snap});
      candidate.first = static_cast<int>(i);
      candidate.second = static_cast<int>(j);
      candidate.support = seen.Support(p, q);
      if (candidate.votes == 0 && !(candidate.support >= options.min_support)) continue;
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

// Indices of the scores, the surest first; of equal ones the first.
std::vector<std::size_t> SurestFirst(std::span<const float> scores) {
  std::vector<std::size_t> order(scores.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return scores[a] > scores[b]; });
  return order;
}

// A line's image between its ends.
class Stretch {
 public:
  Stretch(const Keypoint& start, const Keypoint& end)
      : start_(start), end_(end), length_(std::hypot(end.x - start.x, end.y - start.y)) {
    along_x_ = (end.x - start.x) / std::max(length_, 1e-6F);
    along_y_ = (end.y - start.y) / std::max(length_, 1e-6F);
  }

  // Intersection over union with another one along this one; 0 where they do not lie on one line.
  float Overlap(const Stretch& other, float radius) const {
    if (std::min(Distance(other), other.Distance(*this)) >= radius) return 0;
    const float a = Along(other.start_), b = Along(other.end_);
    const float common = std::min(std::max(a, b), length_) - std::max(std::min(a, b), 0.0F);
    if (common <= 0) return 0;
    return common / (length_ + other.length_ - common);
  }

 private:
  float Along(const Keypoint& point) const {
    return (point.x - start_.x) * along_x_ + (point.y - start_.y) * along_y_;
  }
  float Across(const Keypoint& point) const {
    return std::abs((point.y - start_.y) * along_x_ - (point.x - start_.x) * along_y_);
  }
  // Of the other's farther end from this one, endless.
  float Distance(const Stretch& other) const {
    return std::max(Across(other.start_), Across(other.end_));
  }

  Keypoint start_, end_;
  float length_, along_x_, along_y_;
};

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
  check(overlap_radius >= 0 && std::isfinite(overlap_radius), "overlap_radius", overlap_radius,
        "at least 0 pixels");
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
  return SeenLines(maps, options).Support(start, end);
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
  const auto squared = [&](int i, int j) {
    const Keypoint& p = junctions[static_cast<std::size_t>(i)];
    const Keypoint& q = junctions[static_cast<std::size_t>(j)];
    return (p.x - q.x) * (p.x - q.x) + (p.y - q.y) * (p.y - q.y);
  };
  std::vector<float> result(proposals.size(), -1.0F);
  std::vector<std::size_t> kept;
  for (const std::size_t i : SurestFirst(scores)) {
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

std::vector<float> DiscountOverlaps(std::span<const Keypoint> junctions,
                                    std::span<const LineProposal> proposals,
                                    std::span<const float> scores, float radius) {
  std::vector<float> result(scores.begin(), scores.end());
  std::vector<Stretch> surer;
  std::vector<float> surer_scores;
  for (const std::size_t i : SurestFirst(scores)) {
    if (!(scores[i] > 0)) break;
    const LineProposal& proposal = proposals[i];
    const Stretch stretch(junctions[static_cast<std::size_t>(proposal.start)],
                          junctions[static_cast<std::size_t>(proposal.end)]);
    for (std::size_t k = 0; k < surer.size(); ++k) {
      result[i] *= 1 - surer_scores[k] * surer[k].Overlap(stretch, radius);
    }
    surer.push_back(stretch);
    surer_scores.push_back(scores[i]);
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

}  // namespace airslam
