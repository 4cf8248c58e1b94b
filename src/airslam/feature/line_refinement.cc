// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/feature/line_refinement.h"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

#include "airslam/feature/even_change.h"

namespace airslam {
namespace {

constexpr double kMinLength = 10;  // pixels
constexpr int kPlaces = 32;        // along the line
constexpr double kStep = 0.5;      // pixels across the line
constexpr int kPerPixel = 2;       // steps
// No place counts more than an edge of so many grey levels a pixel, so that what crosses the line
// brightly does not outweigh all of it.
constexpr float kFullGradient = 60;

// How far an edge lies across a line, in pixels along it.
using Deviation = EvenChange;

double PlaceAt(int i) { return (i + 0.5) / kPlaces; }

float Grey(const cv::Mat& image, double x, double y) {
  x = std::clamp(x, 0.0, image.cols - 1.001);
  y = std::clamp(y, 0.0, image.rows - 1.001);
  const int column = static_cast<int>(x), row = static_cast<int>(y);
  const float a = static_cast<float>(x - column), b = static_cast<float>(y - row);
  const auto* upper = image.ptr<std::uint8_t>(row) + column;
  const auto* lower = image.ptr<std::uint8_t>(row + 1) + column;
  const float above = upper[0] + a * static_cast<float>(upper[1] - upper[0]);
  const float below = lower[0] + a * static_cast<float>(lower[1] - lower[0]);
  return above + b * (below - above);
}

// How the grey levels change across a line, at kPlaces along it and in steps of kStep across it.
class EdgeProfiles {
 public:
  EdgeProfiles(const LineSegment& line, const cv::Mat& image, double reach)
      : half_(static_cast<int>(std::lround(reach / kStep)) + kPerPixel), columns_(2 * half_ + 1) {
    const Eigen::Vector2d start(line.x1, line.y1), along(line.x2 - line.x1, line.y2 - line.y1);
    const Eigen::Vector2d across = Eigen::Vector2d(-along.y(), along.x()).normalized();
    std::vector<float> grey(columns_ + 2 * kPerPixel);
    gradient_.reserve(kPlaces * columns_);
    for (int i = 0; i < kPlaces; ++i) {
      const Eigen::Vector2d middle = start + PlaceAt(i) * along;
      for (std::size_t k = 0; k < grey.size(); ++k) {
        const double off = (static_cast<int>(k) - half_ - kPerPixel) * kStep;
        grey[k] = Grey(image, middle.x() + off * across.x(), middle.y() + off * across.y());
      }
      for (int k = 0; k < columns_; ++k) {
        gradient_.push_back((grey[k + 2 * kPerPixel] - grey[k]) / 2);
      }
    }
  }

  int half() const { return half_; }
  // Grey levels a pixel at place i, `step` steps across the line: -half() to half().
  float At(int i, int step) const { return gradient_[i * columns_ + step + half_]; }
  int Nearest(double off) const {
    return std::clamp(static_cast<int>(std::lround(off / kStep)), -half_, half_);
  }

 private:
  int half_, columns_;
  std::vector<float> gradient_;
};

// The best deviation on the grid of steps, and whether the grey levels rise (1) or fall (-1) there.
struct Candidate {
  Deviation deviation;
  float sign = 0;  // 0: there is no gradient at all
};

// Steps across the line from its start's to each place's, when its end lies `tilt` steps farther.
std::array<int, kPlaces> StepsTo(int tilt) {
  std::array<int, kPlaces> steps;
  for (int i = 0; i < kPlaces; ++i) steps[i] = static_cast<int>(std::lround(tilt * PlaceAt(i)));
  return steps;
}

Candidate Strongest(const EdgeProfiles& profiles, const LineRefinementOptions& options) {
  const int most = profiles.half() - kPerPixel;
  const int most_tilt = std::min(static_cast<int>(options.max_tilt / kStep), 2 * most);
  Candidate best;
  double best_score = 0;
  for (int tilt = -most_tilt; tilt <= most_tilt; ++tilt) {
    const std::array<int, kPlaces> steps = StepsTo(tilt);
    for (int first = std::max(-most, -most - tilt); first <= std::min(most, most - tilt); ++first) {
      float sum = 0;
      for (int i = 0; i < kPlaces; ++i) {
        sum += std::clamp(profiles.At(i, first + steps[i]), -kFullGradient, kFullGradient);
      }
      const Deviation deviation{first * kStep, (first + tilt) * kStep};
      const double off = std::hypot(deviation.at_start, deviation.at_end) / options.usual_error;
      const double score = std::abs(sum) * std::exp(-off * off / 4);
      if (score > best_score) {
        best_score = score;
        best = {deviation, sum > 0 ? 1.0F : -1.0F};
      }
    }
  }
  return best;
}

// Where the gradient of one place is greatest near `about`; nothing where it is no maximum or too
// low. By a parabola through the maximum and one pixel to either side: nearer ones, which share
// their pixels, draw it towards the middle of a pixel.
std::optional<double> Crest(const EdgeProfiles& profiles, int place, double about, float sign,
                            double min_gradient) {
  const auto height = [&](int step) { return sign * profiles.At(place, step); };
  const int most = profiles.half() - kPerPixel;
  int step = std::clamp(profiles.Nearest(about), -most, most);
  for (int climb = 0; climb < kPerPixel; ++climb) {
    const int up = height(step + 1) > height(step - 1) ? step + 1 : step - 1;
    if (height(up) > height(step)) step = std::clamp(up, -most, most);
  }
  const double top = height(step);
  if (top < min_gradient || height(step - 1) > top || height(step + 1) > top) return std::nullopt;
  const double before = height(step - kPerPixel), after = height(step + kPerPixel);
  const double curvature = before + after - 2 * top;
  if (curvature > -1e-6) return std::nullopt;
  return kStep * (step + kPerPixel * 0.5 * (before - after) / curvature);
}

// Least squares over the crests that lie within `max_residual` of a deviation.
std::optional<Deviation> FitCrests(const EdgeProfiles& profiles, const Candidate& about,
                                   double max_residual, const LineRefinementOptions& options) {
  std::vector<PlacedValue> crests;
  for (int i = 0; i < kPlaces; ++i) {
    const double expected = about.deviation.At(PlaceAt(i));
    const auto crest = Crest(profiles, i, expected, about.sign, options.min_gradient);
    if (crest && std::abs(*crest - expected) <= max_residual)
      crests.push_back({PlaceAt(i), *crest});
  }
  const auto seen = static_cast<double>(crests.size());
  if (seen < options.min_share * kPlaces || seen < 2) return std::nullopt;
  return FitEvenChange(crests);
}

LineSegment Moved(const LineSegment& line, const Deviation& deviation) {
  const float length = std::hypot(line.x2 - line.x1, line.y2 - line.y1);
  const float x = -(line.y2 - line.y1) / length, y = (line.x2 - line.x1) / length;
  const auto first = static_cast<float>(deviation.at_start);
  const auto last = static_cast<float>(deviation.at_end);
  return {line.x1 + first * x, line.y1 + first * y, line.x2 + last * x, line.y2 + last * y,
          line.score};
}

}  // namespace

std::optional<LineSegment> RefineLine(const LineSegment& line, const cv::Mat& image,
                                      const LineRefinementOptions& options) {
  if (std::hypot(line.x2 - line.x1, line.y2 - line.y1) < kMinLength) return std::nullopt;
  const EdgeProfiles profiles(line, image, options.reach);
  Candidate edge = Strongest(profiles, options);
  if (edge.sign == 0) return std::nullopt;
  // The grid is coarse: the first fits must reach farther than what the last accepts.
  for (const double factor : {2.0, std::numbers::sqrt2, 1.0}) {
    const auto fit = FitCrests(profiles, edge, factor * options.max_residual, options);
    if (!fit) return std::nullopt;
    edge.deviation = *fit;
  }
  const double farthest =
      std::max(std::abs(edge.deviation.at_start), std::abs(edge.deviation.at_end));
  if (farthest > options.reach) return std::nullopt;
  return Moved(line, edge.deviation);
}

}  // namespace airslam
