// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/feature/patch_alignment.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <opencv2/core/hal/intrin.hpp>

namespace airslam {
namespace {

using Four = cv::v_float32x4;

constexpr int kHalf = 5;
constexpr int kSide = 2 * kHalf + 1;
constexpr int kArea = kSide * kSide;
constexpr float kMinDeviation = 1.0F;  // grey levels: below it a patch is noise of the 8-bit range

// Row by row, a zero after each row of kSide, so that a row is three vectors of four. What the
// zeros are for is that sums over all of it are sums over the patch.
constexpr int kRow = kSide + 1;
struct alignas(16) Patch {
  std::array<float, kRow * kSide> values;

  float* row(int y) { return values.data() + static_cast<std::ptrdiff_t>(y) * kRow; }
  const float* row(int y) const { return values.data() + static_cast<std::ptrdiff_t>(y) * kRow; }
};

// One for each of the last four of a row, zero for the zero after it.
Four LastOfRow() { return {1, 1, 1, 0}; }

float Sum(const Patch& patch) {
  Four sum0 = cv::v_setzero_f32(), sum1 = sum0, sum2 = sum0;
  for (int y = 0; y < kSide; ++y) {
    const float* p = patch.row(y);
    sum0 += cv::v_load_aligned(p);
    sum1 += cv::v_load_aligned(p + 4);
    sum2 += cv::v_load_aligned(p + 8);
  }
  return cv::v_reduce_sum(sum0 + sum1 + sum2);
}

float Dot(const Patch& a, const Patch& b) {
  Four sum0 = cv::v_setzero_f32(), sum1 = sum0, sum2 = sum0;
  for (int y = 0; y < kSide; ++y) {
    const float *p = a.row(y), *q = b.row(y);
    sum0 += cv::v_load_aligned(p) * cv::v_load_aligned(q);
    sum1 += cv::v_load_aligned(p + 4) * cv::v_load_aligned(q + 4);
    sum2 += cv::v_load_aligned(p + 8) * cv::v_load_aligned(q + 8);
  }
  return cv::v_reduce_sum(sum0 + sum1 + sum2);
}

// patch = (patch - mean) * scale, of the values only.
void ShiftAndScale(float mean, float scale, Patch& patch) {
  const Four shift = cv::v_setall_f32(mean), factor = cv::v_setall_f32(scale);
  const Four last = LastOfRow();
  for (int y = 0; y < kSide; ++y) {
    float* p = patch.row(y);
    cv::v_store_aligned(p, (cv::v_load_aligned(p) - shift) * factor);
    cv::v_store_aligned(p + 4, (cv::v_load_aligned(p + 4) - shift) * factor);
    cv::v_store_aligned(p + 8, (cv::v_load_aligned(p + 8) - shift) * factor * last);
  }
}

// The normalised template with its normalised gradients.
struct Template {
  Patch value;
  Patch gradient_x;
  Patch gradient_y;
  float level;  // mean grey before
  Eigen::Matrix2d hessian_inverse;
};

// Not OpenCV's v_load_expand_q, which reads an int from an address that is none of an int's.
Four LoadGrey(const std::uint8_t* p) {
  std::uint32_t bytes;
  std::memcpy(&bytes, p, sizeof(bytes));
  const cv::v_uint8x16 grey = cv::v_reinterpret_as_u8(cv::v_uint32x4(bytes, 0, 0, 0));
  return cv::v_cvt_f32(cv::v_reinterpret_as_s32(cv::v_expand_low(cv::v_expand_low(grey))));
}

// Samples the axis-aligned patch around `pixel` less `level`: all samples share their bilinear
// weights. False where it leaves the image.
bool SampleTranslated(const cv::Mat& image, const Eigen::Vector2d& pixel, float level,
                      Patch& patch) {
  // Far outside would not fit into an int.
  if (!(pixel.x() >= kHalf && pixel.y() >= kHalf && pixel.x() < image.cols - kHalf - 1 &&
        pixel.y() < image.rows - kHalf - 1)) {
    return false;
  }
  const int x0 = static_cast<int>(pixel.x()), y0 = static_cast<int>(pixel.y());
  const Four right = cv::v_setall_f32(static_cast<float>(pixel.x() - x0));
  const Four below = cv::v_setall_f32(static_cast<float>(pixel.y() - y0));
  const Four shift = cv::v_setall_f32(level);
  const Four last = LastOfRow();
  Four above0 = cv::v_setzero_f32(), above1 = above0, above2 = above0;
  for (int y = 0; y <= kSide; ++y) {
    const std::uint8_t* source = image.ptr<std::uint8_t>(y0 - kHalf + y) + x0 - kHalf;
    const Four grey0 = LoadGrey(source), grey1 = LoadGrey(source + 4);
    const Four grey2 = LoadGrey(source + 8);
    const Four row0 = grey0 + right * (LoadGrey(source + 1) - grey0);
    const Four row1 = grey1 + right * (LoadGrey(source + 5) - grey1);
    // Of the last four only three are samples: no grey beyond the fourth, which may not exist.
    const Four row2 = grey2 + right * (cv::v_rotate_right<1>(grey2) - grey2);
    if (y > 0) {
      float* out = patch.row(y - 1);
      cv::v_store_aligned(out, above0 + below * (row0 - above0) - shift);
      cv::v_store_aligned(out + 4, above1 + below * (row1 - above1) - shift);
      cv::v_store_aligned(out + 8, (above2 + below * (row2 - above2) - shift) * last);
    }
    above0 = row0;
    above1 = row1;
    above2 = row2;
  }
  return true;
}

// A patch with a border of one for the gradients, in rows that are a multiple of four long.
constexpr int kWideRow = kSide + 5;
using WidePatch = std::array<float, kWideRow*(kSide + 2)>;

// Four bilinear samples at x, y >= 0 from `origin`.
Four SampleFour(const std::uint8_t* origin, std::ptrdiff_t step, const Four& x, const Four& y) {
  const cv::v_int32x4 column = cv::v_trunc(x), row = cv::v_trunc(y);
  alignas(16) std::array<int, 4> columns, rows;
  cv::v_store_aligned(columns.data(), column);
  cv::v_store_aligned(rows.data(), row);
  std::array<const std::uint8_t*, 4> p;
  for (std::size_t i = 0; i < 4; ++i) p[i] = origin + rows[i] * step + columns[i];
  const auto grey = [&p](std::ptrdiff_t offset) {
    return cv::v_cvt_f32(cv::v_int32x4(p[0][offset], p[1][offset], p[2][offset], p[3][offset]));
  };
  const Four right = x - cv::v_cvt_f32(column), below = y - cv::v_cvt_f32(row);
  const Four top_left = grey(0), bottom_left = grey(step);
  const Four top = top_left + right * (grey(1) - top_left);
  const Four bottom = bottom_left + right * (grey(step + 1) - bottom_left);
  return top + below * (bottom - top);
}

// Samples the reference through the change of shape. False where it leaves the image.
bool SampleWarped(const cv::Mat& image, const Eigen::Vector2d& pixel,
                  const Eigen::Matrix2d& reference_from_current, WidePatch& samples) {
  const Eigen::Vector2d reach =
      reference_from_current.cwiseAbs() * Eigen::Vector2d::Constant(kHalf + 1);
  if (!(pixel.x() - reach.x() >= 0 && pixel.y() - reach.y() >= 0 &&
        pixel.x() + reach.x() < image.cols - 1 && pixel.y() + reach.y() < image.rows - 1)) {
    return false;
  }
  // Places are counted from a corner nearby: single precision is enough for them there.
  const int x0 = static_cast<int>(pixel.x() - reach.x());
  const int y0 = static_cast<int>(pixel.y() - reach.y());
  const std::uint8_t* origin = image.ptr<std::uint8_t>(y0) + x0;
  const auto step = static_cast<std::ptrdiff_t>(image.step[0]);
  const Eigen::Matrix2f m = reference_from_current.cast<float>();
  const auto centre_x = static_cast<float>(pixel.x() - x0);
  const auto centre_y = static_cast<float>(pixel.y() - y0);
  const Four zero = cv::v_setzero_f32();
  float* out = samples.data();
  for (int dy = -kHalf - 1; dy <= kHalf + 1; ++dy) {
    const Four row_x = cv::v_setall_f32(centre_x + m(0, 1) * static_cast<float>(dy));
    const Four row_y = cv::v_setall_f32(centre_y + m(1, 1) * static_cast<float>(dy));
    for (int first = -kHalf - 1; first <= kHalf + 1; first += 4, out += 4) {
      const Four dx = cv::v_min(Four(0, 1, 2, 3) + cv::v_setall_f32(static_cast<float>(first)),
                                cv::v_setall_f32(kHalf + 1));  // what fills up the row repeats
      const Four x = row_x + cv::v_setall_f32(m(0, 0)) * dx;
      const Four y = row_y + cv::v_setall_f32(m(1, 0)) * dx;
      // Rounding may carry a corner just across zero.
      cv::v_store(out, SampleFour(origin, step, cv::v_max(x, zero), cv::v_max(y, zero)));
    }
  }
  return true;
}

// The derivative of a normalised patch has neither a mean nor a part along the patch itself.
void ProjectGradient(const Patch& value, float deviation, Patch& gradient) {
  ShiftAndScale(Sum(gradient) / kArea, 1 / deviation, gradient);
  const Four along = cv::v_setall_f32(Dot(value, gradient) / kArea);
  for (std::size_t i = 0; i < gradient.values.size(); i += 4) {
    float* g = gradient.values.data() + i;
    cv::v_store_aligned(
        g, cv::v_load_aligned(g) - along * cv::v_load_aligned(value.values.data() + i));
  }
}

bool MakeTemplate(const cv::Mat& reference, const Eigen::Vector2d& pixel,
                  const Eigen::Matrix2d& current_from_reference, Template& result) {
  WidePatch samples;
  if (!SampleWarped(reference, pixel, current_from_reference.inverse(), samples)) return false;
  const Four half = cv::v_setall_f32(0.5F), all = cv::v_setall_f32(1), last = LastOfRow();
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kRow; x += 4) {
      const float* s = samples.data() + static_cast<std::ptrdiff_t>(y + 1) * kWideRow + x + 1;
      const Four valid = x + 4 < kRow ? all : last;
      const Four dx = cv::v_load(s + 1) - cv::v_load(s - 1);
      const Four dy = cv::v_load(s + kWideRow) - cv::v_load(s - kWideRow);
      cv::v_store_aligned(result.value.row(y) + x, cv::v_load(s) * valid);
      cv::v_store_aligned(result.gradient_x.row(y) + x, half * dx * valid);
      cv::v_store_aligned(result.gradient_y.row(y) + x, half * dy * valid);
    }
  }
  result.level = Sum(result.value) / kArea;
  ShiftAndScale(result.level, 1, result.value);
  const float deviation = std::sqrt(Dot(result.value, result.value) / kArea);
  if (deviation < kMinDeviation) return false;
  ShiftAndScale(0, 1 / deviation, result.value);
  ProjectGradient(result.value, deviation, result.gradient_x);
  ProjectGradient(result.value, deviation, result.gradient_y);

  Eigen::Matrix2d hessian;
  hessian(0, 0) = Dot(result.gradient_x, result.gradient_x);
  hessian(0, 1) = hessian(1, 0) = Dot(result.gradient_x, result.gradient_y);
  hessian(1, 1) = Dot(result.gradient_y, result.gradient_y);
  const double trace = hessian.trace();
  // A patch that holds one straight edge can slide along it (aperture problem).
  if (hessian.determinant() < 0.005 * trace * trace) return false;
  result.hessian_inverse = hessian.inverse();
  return true;
}

// The deviation of a patch from its mean.
float Deviation(const Patch& patch) {
  const float mean = Sum(patch) / kArea;
  return std::sqrt(std::max(Dot(patch, patch) / kArea - mean * mean, 0.0F));
}

}  // namespace

PatchAlignment AlignPatch(const cv::Mat& reference, const Eigen::Vector2d& reference_pixel,
                          const Eigen::Matrix2d& current_from_reference, const cv::Mat& current,
                          const Eigen::Vector2d& guess, const PatchAlignmentOptions& options) {
  PatchAlignment result;
  result.pixel = guess;
  const double area_scale = current_from_reference.determinant();
  if (!(area_scale > 0.1 && area_scale < 10.0)) return result;
  Template model;
  if (!MakeTemplate(reference, reference_pixel, current_from_reference, model)) return result;

  // The gradients have neither a mean nor a part along the template: their product with the
  // normalised patch less the template is that with the patch, but for the patch's deviation.
  Patch patch;
  for (int iteration = 0; iteration < options.max_iterations; ++iteration) {
    if (!SampleTranslated(current, result.pixel, model.level, patch)) return result;
    const float deviation = Deviation(patch);
    if (deviation < kMinDeviation) return result;
    const Eigen::Vector2d right_side(Dot(model.gradient_x, patch), Dot(model.gradient_y, patch));
    const Eigen::Vector2d step = model.hessian_inverse * right_side / deviation;
    result.pixel -= step;
    if (!((result.pixel - guess).norm() <= options.max_displacement)) return result;
    if (step.norm() < options.convergence) {
      result.converged = true;
      break;
    }
  }
  if (!SampleTranslated(current, result.pixel, model.level, patch)) {
    result.converged = false;
    return result;
  }
  const float deviation = std::max(Deviation(patch), 1e-6F);
  result.correlation = Dot(patch, model.value) / (kArea * deviation);
  result.converged = result.converged && result.correlation >= options.min_correlation;
  return result;
}

}  // namespace airslam
