// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/neural/keypoint_decoder.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/core/hal/intrin.hpp>

#include "airslam/common/error.h"

namespace airslam {
namespace {

// A local maximum at a pixel.
struct Candidate {
  float score;
  std::int32_t row, column;
};

bool Better(const Candidate& a, const Candidate& b) {
  if (a.score != b.score) return a.score > b.score;
  return a.row != b.row ? a.row < b.row : a.column < b.column;
}

// out[x] = the largest of the 2r+1 values of column x around `row`, for x in [0, width).
void ColumnMaxima(const ScoreMap& scores, int row, int radius, float* out) {
  const float* top = scores.data + static_cast<std::ptrdiff_t>(row - radius) * scores.stride;
  int x = 0;
  for (; x + 4 <= scores.width; x += 4) {
    const float* p = top + x;
    cv::v_float32x4 best = cv::v_load(p);
    for (int i = 0; i < 2 * radius; ++i) {
      p += scores.stride;
      best = cv::v_max(best, cv::v_load(p));
    }
    cv::v_store(out + x, best);
  }
  for (; x < scores.width; ++x) {
    const float* p = top + x;
    float best = *p;
    for (int i = 0; i < 2 * radius; ++i) {
      p += scores.stride;
      best = std::max(best, *p);
    }
    out[x] = best;
  }
}

// Whether an earlier pixel, in row-major order, of the square around (x, y) has the same score.
bool HasEarlierEqual(const ScoreMap& scores, int x, int y, int radius, float score) {
  for (int v = y - radius; v <= y; ++v) {
    const float* row = scores.data + static_cast<std::ptrdiff_t>(v) * scores.stride;
    const int end = v < y ? x + radius + 1 : x;
    for (int u = x - radius; u < end; ++u) {
      if (row[u] == score) return true;
    }
  }
  return false;
}

// Whether the mask allows (x, y) and the eight pixels `border` around it, which lie inside.
bool IsAllowed(const cv::Mat& mask, int x, int y, int border) {
  if (mask.empty()) return true;
  for (int v = y - border; v <= y + border; v += border) {
    const std::uint8_t* row = mask.ptr<std::uint8_t>(v);
    if (row[x - border] == 0 || row[x] == 0 || row[x + border] == 0) return false;
  }
  return true;
}

// Appends the local maxima of one row. column_maxima: of this row.
void CollectRow(const ScoreMap& scores, int y, int margin, const float* column_maxima,
                const cv::Mat& mask, const KeypointDecoderOptions& options,
                std::vector<Candidate>& out) {
  const int radius = options.nms_radius;
  const float* row = scores.data + static_cast<std::ptrdiff_t>(y) * scores.stride;
  const int end = scores.width - margin;
  const auto take = [&](int x) {
    const float score = row[x];
    if (!IsAllowed(mask, x, y, options.border)) return;
    if (!HasEarlierEqual(scores, x, y, radius, score)) out.push_back({score, y, x});
  };
  const cv::v_float32x4 threshold = cv::v_setall_f32(options.score_threshold);
  int x = margin;
  for (; x + 4 <= end; x += 4) {
    const cv::v_float32x4 score = cv::v_load(row + x);
    // Most quadruples end here: one that tops its own column is rare.
    int bits = cv::v_signmask((score > threshold) & (score >= cv::v_load(column_maxima + x)));
    if (bits == 0) continue;
    cv::v_float32x4 best = cv::v_load(column_maxima + x - radius);
    for (int i = 1; i <= 2 * radius; ++i) {
      best = cv::v_max(best, cv::v_load(column_maxima + x - radius + i));
    }
    bits &= cv::v_signmask(score >= best);
    for (int i = 0; bits != 0; ++i, bits >>= 1) {
      if ((bits & 1) != 0) take(x + i);
    }
  }
  for (; x < end; ++x) {
    if (!(row[x] > options.score_threshold)) continue;
    const float* first = column_maxima + x - radius;
    if (row[x] >= *std::max_element(first, first + 2 * radius + 1)) take(x);
  }
}

// Moves the best `max_keypoints` candidates to the front, in order, and drops the others.
void KeepBest(std::vector<Candidate>& candidates, std::size_t count) {
  if (candidates.size() > count) {
    std::nth_element(candidates.begin(), candidates.begin() + static_cast<std::ptrdiff_t>(count),
                     candidates.end(), Better);
    candidates.resize(count);
  }
  std::sort(candidates.begin(), candidates.end(), Better);
}

// The same with a quota for each cell of the image; see KeypointDecoderOptions::spread.
void KeepSpread(std::vector<Candidate>& candidates, const ScoreMap& scores,
                const KeypointDecoderOptions& options) {
  const auto count = static_cast<std::size_t>(options.max_keypoints);
  std::sort(candidates.begin(), candidates.end(), Better);
  if (candidates.size() <= count) return;
  const int columns = std::max(1, (scores.width + options.cell_size / 2) / options.cell_size);
  const int rows = std::max(1, (scores.height + options.cell_size / 2) / options.cell_size);
  const int quota = static_cast<int>(
      std::ceil(options.spread * static_cast<float>(count) / static_cast<float>(columns * rows)));
  std::vector<int> taken(static_cast<std::size_t>(columns * rows), 0);
  std::vector<Candidate> kept, others;
  kept.reserve(count);
  for (const Candidate& c : candidates) {
    const int cell = c.row * rows / scores.height * columns + c.column * columns / scores.width;
    if (kept.size() < count && taken[static_cast<std::size_t>(cell)]++ < quota) {
      kept.push_back(c);
    } else {
      others.push_back(c);
    }
  }
  const std::size_t rest = std::min(count - kept.size(), others.size());
  kept.insert(kept.end(), others.begin(), others.begin() + static_cast<std::ptrdiff_t>(rest));
  std::sort(kept.begin(), kept.end(), Better);
  candidates = std::move(kept);
}

// Step from c to the vertex of a parabola through (-1, l), (0, c), (1, r), where c is the largest.
float Vertex(float l, float c, float r) {
  const float curvature = l + r - 2 * c;
  return curvature < 0 ? 0.5F * (l - r) / curvature : 0.0F;
}

Keypoint Refine(const ScoreMap& scores, const Candidate& candidate) {
  const std::ptrdiff_t s = scores.stride;
  const float* p = scores.data + candidate.row * s + candidate.column;
  const float gx = 0.5F * (p[1] - p[-1]);
  const float gy = 0.5F * (p[s] - p[-s]);
  const float hxx = p[1] + p[-1] - 2 * p[0];
  const float hyy = p[s] + p[-s] - 2 * p[0];
  const float hxy = 0.25F * (p[s + 1] + p[-s - 1] - p[s - 1] - p[-s + 1]);
  const float det = hxx * hyy - hxy * hxy;
  float dx = Vertex(p[-1], p[0], p[1]);
  float dy = Vertex(p[-s], p[0], p[s]);
  if (hxx < 0 && det > 1e-6F) {
    const float x = (hxy * gy - hyy * gx) / det;
    const float y = (hxy * gx - hxx * gy) / det;
    // Where the two axes are strongly coupled the extremum may lie far away: then keep them apart.
    if (std::abs(x) <= 1 && std::abs(y) <= 1) {
      dx = x;
      dy = y;
    }
  }
  return {static_cast<float>(candidate.column) + std::clamp(dx, -0.5F, 0.5F),
          static_cast<float>(candidate.row) + std::clamp(dy, -0.5F, 0.5F), candidate.score};
}

}  // namespace

void KeypointDecoderOptions::Validate() const {
  if (max_keypoints < 0) Fail("max_keypoints is {}, expected at least 0", max_keypoints);
  if (nms_radius < 1 || nms_radius > 16) Fail("nms_radius is {}, expected 1 to 16", nms_radius);
  if (border < 1) Fail("border is {}, expected at least 1", border);
  if (!(spread >= 0 && spread <= 1)) Fail("spread is {}, expected 0 to 1", spread);
  if (cell_size < 8) Fail("cell_size is {}, expected at least 8", cell_size);
}

std::vector<Keypoint> DecodeKeypoints(const ScoreMap& scores, const cv::Mat& mask,
                                      const KeypointDecoderOptions& options) {
  options.Validate();
  if (!mask.empty() &&
      (mask.type() != CV_8UC1 || mask.rows != scores.height || mask.cols != scores.width)) {
    Fail("the mask is {}x{} of type {}, expected {}x{} of type CV_8UC1", mask.cols, mask.rows,
         cv::typeToString(mask.type()), scores.width, scores.height);
  }
  const int margin = std::max(options.border, options.nms_radius);
  std::vector<Candidate> candidates;
  std::vector<float> column_maxima(static_cast<std::size_t>(std::max(scores.width, 0)));
  for (int y = margin; y < scores.height - margin; ++y) {
    ColumnMaxima(scores, y, options.nms_radius, column_maxima.data());
    CollectRow(scores, y, margin, column_maxima.data(), mask, options, candidates);
  }
  if (options.spread > 0) {
    KeepSpread(candidates, scores, options);
  } else {
    KeepBest(candidates, static_cast<std::size_t>(options.max_keypoints));
  }
  std::vector<Keypoint> keypoints;
  keypoints.reserve(candidates.size());
  for (const Candidate& c : candidates) {
    keypoints.push_back(options.subpixel ? Refine(scores, c)
                                         : Keypoint{static_cast<float>(c.column),
                                                    static_cast<float>(c.row), c.score});
  }
  return keypoints;
}

}  // namespace airslam
