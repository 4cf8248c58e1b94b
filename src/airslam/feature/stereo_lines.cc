// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/feature/stereo_lines.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "airslam/feature/even_change.h"

namespace airslam {
namespace {

// Disparities in pixels along a line.
using Sample = PlacedValue;
using DisparityLine = EvenChange;

double Residual(const DisparityLine& line, const Sample& sample) {
  return std::abs(sample.value - line.At(sample.place));
}

DisparityLine Through(const Sample& a, const Sample& b) {
  const double slope = (b.value - a.value) / (b.place - a.place);
  const double at_start = a.value - slope * a.place;
  return {at_start, at_start + slope};
}

std::vector<Sample> Agreeing(std::span<const Sample> samples, const DisparityLine& line,
                             double max_residual) {
  std::vector<Sample> agreeing;
  for (const Sample& sample : samples) {
    if (Residual(line, sample) <= max_residual) agreeing.push_back(sample);
  }
  return agreeing;
}

// The line through two of the samples with which most others agree; the earliest pair of equals.
DisparityLine Consensus(std::span<const Sample> samples, double max_residual) {
  DisparityLine best;
  long most = -1;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    for (std::size_t j = i + 1; j < samples.size(); ++j) {
      const DisparityLine line = Through(samples[i], samples[j]);
      const auto agree = std::count_if(samples.begin(), samples.end(), [&](const Sample& sample) {
        return Residual(line, sample) <= max_residual;
      });
      if (agree > most) {
        most = agree;
        best = line;
      }
    }
  }
  return best;
}

// The search of one line.
class RightLineSearch {
 public:
  RightLineSearch(const LineSegment& line, const ImagePyramid& left, const ImagePyramid& right,
                  const StereoLineOptions& options)
      : line_(line), left_(left), right_(right), options_(options) {
    const double length = std::hypot(line.x2 - line.x1, line.y2 - line.y1);
    const bool level = std::abs(line.y2 - line.y1) < options.min_slope * length;
    samples_ = level ? 0 : static_cast<int>(std::clamp(length / options.spacing, 4.0, 24.0));
  }

  std::optional<LineSegment> Find(double max_disparity) const {
    if (samples_ == 0) return std::nullopt;
    const auto coarse = Fitted(Seek(1, [&](double) { return std::pair(-4.0, max_disparity); }),
                               options_.max_residual);
    if (!coarse) return std::nullopt;
    constexpr double kAround = 3;  // pixels: what a half-resolution pixel and its fit may be off
    const auto fine = Fitted(Seek(0,
                                  [&](double place) {
                                    const double about = coarse->At(place);
                                    return std::pair(about - kAround, about + kAround);
                                  }),
                             options_.max_fine_residual);
    if (!fine || fine->at_start < 0 || fine->at_end < 0) return std::nullopt;
    return LineSegment{static_cast<float>(line_.x1 - fine->at_start), line_.y1,
                       static_cast<float>(line_.x2 - fine->at_end), line_.y2, line_.score};
  }

 private:
  // What the samples find at one level of the pyramids within the disparities that `range` allows.
  template <typename Range>
  std::vector<Sample> Seek(int level, Range&& range) const {
    const double scale = 1 << level;
    std::vector<Sample> found;
    for (int i = 0; i < samples_; ++i) {
      const double place = (i + 0.5) / samples_;
      const double x = line_.x1 + place * (line_.x2 - line_.x1);
      const double y = line_.y1 + place * (line_.y2 - line_.y1);
      const int column = static_cast<int>(std::lround(x / scale));
      const int row = static_cast<int>(std::lround(y / scale));
      const auto [least, most] = range(place);
      const auto match =
          SearchRow(left_.levels[level], right_.levels[level], column, row,
                    static_cast<int>(std::floor(column - most / scale)),
                    static_cast<int>(std::ceil(column - least / scale)), options_.search);
      if (match) found.push_back({place, scale * (column - *match)});
    }
    return found;
  }

  std::optional<DisparityLine> Fitted(std::span<const Sample> samples, double max_residual) const {
    const double needed = std::max(3.0, options_.min_share * samples_);
    if (static_cast<double>(samples.size()) < needed) return std::nullopt;
    const auto agreeing = Agreeing(samples, Consensus(samples, max_residual), max_residual);
    if (static_cast<double>(agreeing.size()) < needed) return std::nullopt;
    return FitEvenChange(agreeing);
  }

  const LineSegment& line_;
  const ImagePyramid& left_;
  const ImagePyramid& right_;
  const StereoLineOptions& options_;
  int samples_;
};

}  // namespace

std::vector<LineSegment> FindRightLines(std::span<const LineSegment> left,
                                        const ImagePyramid& left_image,
                                        const ImagePyramid& right_image, const StereoCamera& stereo,
                                        const StereoLineOptions& options) {
  const double max_disparity = stereo.Disparity(options.min_depth);
  std::vector<LineSegment> right;
  right.reserve(left.size());
  for (const LineSegment& line : left) {
    right.push_back(RightLineSearch(line, left_image, right_image, options)
                        .Find(max_disparity)
                        .value_or(kNoLine));
  }
  return right;
}

}  // namespace airslam
