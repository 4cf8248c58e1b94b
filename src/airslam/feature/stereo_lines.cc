// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/feature/stereo_lines.h"

#include <algorithm>
#include <cmath>
#include <optional>

namespace airslam {
namespace {

// A place along a line, 0 at its start and 1 at its end, and the disparity found there.
struct Sample {
  double place = 0;
  double disparity = 0;  // pixels
};

// disparity = at_start + place * (at_end - at_start)
struct DisparityLine {
  double at_start = 0;
  double at_end = 0;

  double At(double place) const { return at_start + place * (at_end - at_start); }
  double Residual(const Sample& sample) const {
    return std::abs(sample.disparity - At(sample.place));
  }
};

DisparityLine Through(const Sample& a, const Sample& b) {
  const double slope = (b.disparity - a.disparity) / (b.place - a.place);
  const double at_start = a.disparity - slope * a.place;
  return {at_start, at_start + slope};
}

std::vector<Sample> Agreeing(std::span<const Sample> samples, const DisparityLine& line,
                             double max_residual) {
  std::vector<Sample> agreeing;
  for (const Sample& sample : samples) {
    if (line.Residual(sample) <= max_residual) agreeing.push_back(sample);
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
        return line.Residual(sample) <= max_residual;
      });
      if (agree > most) {
        most = agree;
        best = line;
      }
    }
  }
  return best;
}

// Least squares. The places differ.
DisparityLine Fit(std::span<const Sample> samples) {
  double n = 0, place = 0, disparity = 0;
  for (const Sample& s : samples) {
    n += 1;
    place += s.place;
    disparity += s.disparity;
  }
  place /= n;
  disparity /= n;
  double square = 0, product = 0;
  for (const Sample& s : samples) {
    square += (s.place - place) * (s.place - place);
    product += (s.place - place) * (s.disparity - disparity);
  }
  const double slope = product / square;
  return {disparity - slope * place, disparity + slope * (1 - place)};
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
    return Fit(agreeing);
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
