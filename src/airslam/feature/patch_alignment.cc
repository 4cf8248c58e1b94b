// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/feature/patch_alignment.h"

#include <Eigen/LU>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

namespace airslam {
namespace {

constexpr int kHalf = 5;
constexpr int kSide = 2 * kHalf + 1;
constexpr int kArea = kSide * kSide;
constexpr float kMinDeviation = 1.0f;  // grey levels: below it a patch is noise of the 8-bit range

using Patch = std::array<float, kArea>;

// The normalised template with its normalised gradients.
struct Template {
  Patch value;
  Patch gradient_x;
  Patch gradient_y;
  Eigen::Matrix2d hessian_inverse;
};

// Subtracts the mean and divides by the deviation. Returns the deviation before.
float Normalize(Patch& patch) {
  float sum = 0;
  for (float v : patch) sum += v;
  const float mean = sum / kArea;
  float squares = 0;
  for (float& v : patch) {
    v -= mean;
    squares += v * v;
  }
  const float deviation = std::sqrt(squares / kArea);
  const float scale = 1.0f / std::max(deviation, 1e-6f);
  for (float& v : patch) v *= scale;
  return deviation;
}

float Dot(const Patch& a, const Patch& b) {
  float sum = 0;
  for (int i = 0; i < kArea; ++i) sum += a[i] * b[i];
  return sum;
}

float Bilinear(const cv::Mat& image, double x, double y) {
  const int x0 = static_cast<int>(x);
  const int y0 = static_cast<int>(y);
  const float fx = static_cast<float>(x - x0);
  const float fy = static_cast<float>(y - y0);
  const std::uint8_t* top = image.ptr<std::uint8_t>(y0) + x0;
  const std::uint8_t* bottom = top + image.step[0];
  return (1 - fy) * ((1 - fx) * top[0] + fx * top[1]) + fy * ((1 - fx) * bottom[0] + fx * bottom[1]);
}

// Samples the axis-aligned patch around `pixel`: all samples share their bilinear weights.
bool SampleTranslated(const cv::Mat& image, const Eigen::Vector2d& pixel, Patch& patch) {
  const int x0 = static_cast<int>(std::floor(pixel.x()));
  const int y0 = static_cast<int>(std::floor(pixel.y()));
  if (x0 < kHalf || y0 < kHalf || x0 + kHalf + 1 >= image.cols || y0 + kHalf + 1 >= image.rows) {
    return false;
  }
  const float fx = static_cast<float>(pixel.x() - x0);
  const float fy = static_cast<float>(pixel.y() - y0);
  const float w00 = (1 - fx) * (1 - fy), w01 = fx * (1 - fy), w10 = (1 - fx) * fy, w11 = fx * fy;
  for (int dy = -kHalf; dy <= kHalf; ++dy) {
    const std::uint8_t* top = image.ptr<std::uint8_t>(y0 + dy) + x0 - kHalf;
    const std::uint8_t* bottom = top + image.step[0];
    float* out = patch.data() + (dy + kHalf) * kSide;
    for (int i = 0; i < kSide; ++i) {
      out[i] = w00 * top[i] + w01 * top[i + 1] + w10 * bottom[i] + w11 * bottom[i + 1];
    }
  }
  return true;
}

// Samples the reference through the change of shape, with a border of one for the gradients.
bool SampleWarped(const cv::Mat& image, const Eigen::Vector2d& pixel,
                  const Eigen::Matrix2d& reference_from_current,
                  std::array<float, (kSide + 2) * (kSide + 2)>& samples) {
  const Eigen::Vector2d reach = reference_from_current.cwiseAbs() * Eigen::Vector2d::Constant(kHalf + 1);
  if (!(pixel.x() - reach.x() >= 0 && pixel.y() - reach.y() >= 0 &&
        pixel.x() + reach.x() < image.cols - 1 && pixel.y() + reach.y() < image.rows - 1)) {
    return false;
  }
  float* out = samples.data();
  for (int dy = -kHalf - 1; dy <= kHalf + 1; ++dy) {
    for (int dx = -kHalf - 1; dx <= kHalf + 1; ++dx) {
      const Eigen::Vector2d p = pixel + reference_from_current * Eigen::Vector2d(dx, dy);
      *out++ = Bilinear(image, p.x(), p.y());
    }
  }
  return true;
}

// The derivative of a normalised patch has neither a mean nor a part along the patch itself.
void ProjectGradient(const Patch& value, float deviation, Patch& gradient) {
  float sum = 0;
  for (float g : gradient) sum += g;
  for (float& g : gradient) g = (g - sum / kArea) / deviation;
  const float along = Dot(value, gradient) / kArea;
  for (int i = 0; i < kArea; ++i) gradient[i] -= along * value[i];
}

bool MakeTemplate(const cv::Mat& reference, const Eigen::Vector2d& pixel,
                  const Eigen::Matrix2d& current_from_reference, Template& result) {
  constexpr int kWide = kSide + 2;
  std::array<float, kWide * kWide> samples;
  if (!SampleWarped(reference, pixel, current_from_reference.inverse(), samples)) return false;
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      const float* s = samples.data() + (y + 1) * kWide + x + 1;
      result.value[y * kSide + x] = s[0];
      result.gradient_x[y * kSide + x] = 0.5f * (s[1] - s[-1]);
      result.gradient_y[y * kSide + x] = 0.5f * (s[kWide] - s[-kWide]);
    }
  }
  const float deviation = Normalize(result.value);
  if (deviation < kMinDeviation) return false;
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

  Patch patch;
  for (int iteration = 0; iteration < options.max_iterations; ++iteration) {
    if (!SampleTranslated(current, result.pixel, patch)) return result;
    if (Normalize(patch) < kMinDeviation) return result;
    Patch residual;
    for (int i = 0; i < kArea; ++i) residual[i] = patch[i] - model.value[i];
    const Eigen::Vector2d right_side(Dot(model.gradient_x, residual),
                                     Dot(model.gradient_y, residual));
    const Eigen::Vector2d step = model.hessian_inverse * right_side;
    result.pixel -= step;
    if (!((result.pixel - guess).norm() <= options.max_displacement)) return result;
    if (step.norm() < options.convergence) {
      result.converged = true;
      break;
    }
  }
  if (!SampleTranslated(current, result.pixel, patch)) {
    result.converged = false;
    return result;
  }
  Normalize(patch);
  result.correlation = Dot(patch, model.value) / kArea;
  result.converged = result.converged && result.correlation >= options.min_correlation;
  return result;
}

}  // namespace airslam
