// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/neural/line_support.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "airslam/neural/line_cells.h"

// Compiled for AVX2, too, and chosen when the program starts. AVX2 alone has no fused
// multiplication and addition, so that the bits are the same on either way.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define AIRSLAM_ALSO_FOR_AVX2 __attribute__((target_clones("avx2", "default")))
#else
#define AIRSLAM_ALSO_FOR_AVX2
#endif

namespace airslam {
namespace {

constexpr int kSamples = 16;
constexpr int kBatch = 8;  // lines at once

// Samples along a line, as shares of its length. The middle comes first: near its ends other lines
// of the junctions may agree, so that what is no line shows there last.
constexpr std::array<float, kSamples> kPlaces = [] {
  std::array<float, kSamples> places = {8, 4, 12, 6, 10, 2, 14, 7, 9, 5, 11, 3, 13, 1, 0, 15};
  for (float& place : places) place = (place + 0.5F) / kSamples;
  return places;
}();
constexpr float kOffset = 5;    // pixels
constexpr float kDistance = 4;  // pixels
constexpr float kCosine = 0.85F;
constexpr float kConfidence = 0.2F;

// Directions around the circle in bins that need no arctangent: the circle is taken for a square
// that stands on its tip, with as many bins on each of its sides.
constexpr int kDirections = 32;

// The bin of a direction of any length but zero; some bin of what is no direction.
[[gnu::always_inline]] inline int DirectionBin(float x, float y) {
  const float height = y / (std::abs(x) + std::abs(y));  // -1..1
  const float place = (x < 0 ? 3 - height : 1 + height) * (kDirections / 4);
  const float number = place > 0 ? place : 0;  // also for not-a-number
  return static_cast<int>(number < kDirections - 1 ? number : kDirections - 1);
}

[[gnu::always_inline]] inline int OppositeBin(int bin) {
  return (bin + kDirections / 2) & (kDirections - 1);
}

// The angle at which a bin begins.
double BinEdge(int bin) {
  const double place = 4.0 * bin / kDirections;
  const double y = place <= 2 ? place - 1 : 3 - place;
  return std::atan2(y, (place <= 2 ? 1 : -1) * (1 - std::abs(y)));
}

// For each bin those that hold a direction within the angle of kCosine of one of its own.
std::array<std::uint32_t, kDirections> NearDirections() {
  constexpr double kMargin = 0.01;  // for directions that rounding puts into the next bin
  const double angle = std::acos(kCosine) + kMargin;
  std::array<std::uint32_t, kDirections> near = {};
  for (int a = 0; a < kDirections; ++a) {
    for (int b = 0; b < kDirections; ++b) {
      bool is_near = a == b;
      for (const double from : {BinEdge(a), BinEdge(a + 1)}) {
        for (const double to : {BinEdge(b), BinEdge(b + 1)}) {
          is_near = is_near || std::abs(std::remainder(from - to, 2 * std::numbers::pi)) < angle;
        }
      }
      if (is_near) near[static_cast<std::size_t>(a)] |= std::uint32_t{1} << b;
    }
  }
  return near;
}

// A line from p along (dx, dy), and its normal of unit length.
struct Line {
  float x, y, dx, dy, normal_x, normal_y;
};

// The cell, in row-major order, that is nearest to the sample at `place`, moved sideways.
[[gnu::always_inline]] inline int CellAt(const SeenLines::Grid& grid, const Line& line, float place,
                                         float side) {
  const auto nearest = [&grid](float pixel, float last) {
    const float cell = (pixel - grid.offset) * grid.per_stride + 0.5F;  // to be rounded down
    const float positive = cell > 0 ? cell : 0;
    return static_cast<int>(positive < last ? positive : last);
  };
  const int column = nearest(line.x + place * line.dx + side * line.normal_x, grid.last_column);
  const int row = nearest(line.y + place * line.dy + side * line.normal_y, grid.last_row);
  return static_cast<int>(static_cast<float>(row) * grid.width) + column;
}

// Lines from one junction to kBatch others, and the bits of their normals' directions.
struct LineBatch {
  std::array<float, kBatch> dx, dy, length, normal_x, normal_y;
  std::array<std::uint32_t, kBatch> bit, opposite_bit;
};

[[gnu::always_inline]] inline LineBatch MakeBatch(const Keypoint& p, const Keypoint* others,
                                                  std::size_t count) {
  LineBatch lines;
  for (std::size_t k = 0; k < kBatch; ++k) {
    const Keypoint& q = others[std::min(k, count - 1)];
    lines.dx[k] = q.x - p.x;
    lines.dy[k] = q.y - p.y;
  }
  for (std::size_t k = 0; k < kBatch; ++k) {
    const float dx = lines.dx[k], dy = lines.dy[k];
    lines.length[k] = std::sqrt(dx * dx + dy * dy);
    const float divisor = lines.length[k] > 0 ? lines.length[k] : 1;
    lines.normal_x[k] = -dy / divisor;
    lines.normal_y[k] = dx / divisor;
    const int bin = DirectionBin(-dy, dx);
    lines.bit[k] = std::uint32_t{1} << bin;
    lines.opposite_bit[k] = std::uint32_t{1} << OppositeBin(bin);
  }
  return lines;
}

// For each of kBatch lines from p to others, of which `count` are meant: how many of the samples
// have a cell with the bit of the line's direction on its side; 0 where they cannot be `enough`.
AIRSLAM_ALSO_FOR_AVX2
void CountPossible(const SeenLines::Grid& grid, const std::uint32_t* marks, const Keypoint& p,
                   const Keypoint* others, std::size_t count, float enough, int* hits) {
  const LineBatch lines = MakeBatch(p, others, count);
  const auto hit = [&](std::size_t k, float place) {
    const Line line{p.x, p.y, lines.dx[k], lines.dy[k], lines.normal_x[k], lines.normal_y[k]};
    const std::uint32_t ahead = marks[CellAt(grid, line, place, kOffset)];
    const std::uint32_t behind = marks[CellAt(grid, line, place, -kOffset)];
    return ((ahead & lines.bit[k]) | (behind & lines.opposite_bit[k])) != 0 ? 1 : 0;
  };
  std::array<int, kBatch> found = {};
  for (std::size_t i = 0; i < kSamples / 2; ++i) {  // one sample of all lines at once
    for (std::size_t k = 0; k < kBatch; ++k) found[k] += hit(k, kPlaces[i]);
  }
  // Most have too few by now, whatever the other half holds.
  for (std::size_t k = 0; k < kBatch; ++k) {
    hits[k] = 0;
    if (!(lines.length[k] > 0) || static_cast<float>(found[k] + kSamples / 2) < enough) continue;
    int more = 0;
    for (std::size_t i = kSamples / 2; i < kSamples; ++i) more += hit(k, kPlaces[i]);
    hits[k] = found[k] + more;
  }
}

// How many of the samples have a cell that agrees.
AIRSLAM_ALSO_FOR_AVX2
int CountAgreeing(const SeenLines::Grid& grid, const SeenLines::Seen* cells, const Line& line) {
  std::array<int, 2 * kSamples> asked;
  for (std::size_t i = 0; i < kSamples; ++i) {
    asked[i] = CellAt(grid, line, kPlaces[i], -kOffset);
    asked[i + kSamples] = CellAt(grid, line, kPlaces[i], kOffset);
  }
  std::array<int, 2 * kSamples> agrees;
  for (std::size_t i = 0; i < asked.size(); ++i) {
    const SeenLines::Seen& seen = cells[asked[i]];
    const float distance = (seen.x - line.x) * line.normal_x + (seen.y - line.y) * line.normal_y;
    const float along = seen.cosine * line.normal_x + seen.sine * line.normal_y;
    // Without a branch: which it will be cannot be foreseen.
    agrees[i] = static_cast<int>(std::abs(distance) < kDistance) &
                static_cast<int>(std::abs(along) > kCosine);
  }
  int count = 0;
  for (std::size_t i = 0; i < kSamples; ++i) count += agrees[i] | agrees[i + kSamples];
  return count;
}

}  // namespace

SeenLines::SeenLines(const LineMaps& maps, const LineDecoderOptions& options)
    : grid_{Centre(0, options.stride), 1 / static_cast<float>(options.stride),
            static_cast<float>(maps.width - 1), static_cast<float>(maps.height - 1),
            static_cast<float>(maps.width)},
      cells_(static_cast<std::size_t>(Plane(maps))),
      marks_(cells_.size(), 0) {
  const std::ptrdiff_t plane = Plane(maps);
  const float threshold = Logit(kConfidence);
  const float* cell = maps.field;
  for (int row = 0; row < maps.height; ++row) {
    for (int column = 0; column < maps.width; ++column, ++cell) {
      if (!(*cell > threshold)) continue;
      const float b = cell[2 * plane], c = cell[3 * plane];
      const float norm = std::max(std::sqrt(b * b + c * c), 1e-6F);
      const float d = options.reach * Sigmoid(cell[plane]);
      Seen& seen = cells_[static_cast<std::size_t>(cell - maps.field)];
      seen.cosine = b / norm;
      seen.sine = c / norm;
      seen.x = Centre(column, options.stride) + d * seen.cosine;
      seen.y = Centre(row, options.stride) + d * seen.sine;
      Mark(row, column, options.stride);
    }
  }
}

void SeenLines::Mark(int row, int column, int stride) {
  static const std::array<std::uint32_t, kDirections> kNear = NearDirections();
  const auto columns = static_cast<int>(grid_.last_column), rows = static_cast<int>(grid_.last_row);
  const std::size_t i = static_cast<std::size_t>(row) * static_cast<std::size_t>(columns + 1) +
                        static_cast<std::size_t>(column);
  const Seen& seen = cells_[i];
  // Written so that not-a-number agrees with nothing.
  if (!(std::abs(seen.cosine) + std::abs(seen.sine) > 0)) return;
  // A cell's centre lies up to half its diagonal from the samples that ask it, except at the
  // border, which stands for all that lies beyond.
  const bool border = row == 0 || column == 0 || row == rows || column == columns;
  const float half = static_cast<float>(stride) * 0.71F;
  const float ahead = (half + kOffset + kDistance) / kCosine;   // the farthest foot
  const float behind = (half - kOffset + kDistance) / kCosine;  // of one on the line's other side
  const float dx = seen.x - Centre(column, stride), dy = seen.y - Centre(row, stride);
  const float squared = dx * dx + dy * dy;
  const int bin = DirectionBin(seen.cosine, seen.sine);
  if (border || squared < ahead * ahead) {
    marks_[i] |= kNear[static_cast<std::size_t>(OppositeBin(bin))];
  }
  if (border || squared < behind * behind) marks_[i] |= kNear[static_cast<std::size_t>(bin)];
}

float SeenLines::Support(const Keypoint& p, const Keypoint& q) const {
  const float length = Distance(p, q);
  if (!(length > 0)) return 0;
  const float dx = q.x - p.x, dy = q.y - p.y;
  const Line line{p.x, p.y, dx, dy, -dy / length, dx / length};
  return static_cast<float>(CountAgreeing(grid_, cells_.data(), line)) / kSamples;
}

void SeenLines::FindPossible(const Keypoint& p, std::span<const Keypoint> others, float least,
                             std::span<std::uint8_t> possible) const {
  const float enough = least * kSamples;
  std::array<int, kBatch> hits;
  for (std::size_t first = 0; first < others.size(); first += kBatch) {
    const std::size_t count = std::min<std::size_t>(kBatch, others.size() - first);
    CountPossible(grid_, marks_.data(), p, others.data() + first, count, enough, hits.data());
    for (std::size_t k = 0; k < count; ++k) {
      possible[first + k] = static_cast<float>(hits[k]) >= enough ? 1 : 0;
    }
  }
}

}  // namespace airslam
