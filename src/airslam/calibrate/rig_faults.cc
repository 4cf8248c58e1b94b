// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/calibrate/rig_faults.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

#include <fmt/format.h>

#include "airslam/feature/stereo_matching.h"

namespace airslam {
namespace {

constexpr double kDegrees = 180 / std::numbers::pi;
constexpr int kMinMatches = 60;
constexpr int kMinMoving = 60;       // matches with a velocity, to judge a delay
constexpr double kAdvantage = 1.33;  // by which a fit must beat a hypothesis
constexpr double kSameCost = 1.1;    // hypotheses that are not told apart
constexpr double kExplained = 0.6;   // of the calibration's cost: what explains it has less
constexpr int kMaxShift = 2;         // frames

// Between the sizes of images that one sensor gives.
constexpr std::array kUsualScales = {0.25,    1 / 3.0, 0.5, 2 / 3.0, 0.75,
                                     4 / 3.0, 1.5,     2.0, 3.0,     4.0};

// What may explain the matches better than the calibration does.
struct Explanation {
  RigFault fault = RigFault::kUnexplained;
  std::string text;
  double cost = 0;
  double median = 0;  // pixels, of the epipolar errors that remain
};

StereoRig Scaled(StereoRig rig, double scale) {
  for (RigCamera* camera : {&rig.left, &rig.right}) {
    Pinhole& p = camera->camera.pinhole;
    p.fx *= scale;
    p.fy *= scale;
    p.cx = scale * (p.cx + 0.5) - 0.5;  // integer coordinates are pixel centres
    p.cy = scale * (p.cy + 0.5) - 0.5;
  }
  return rig;
}

void AddInverted(const StereoRig& rig, std::vector<RigHypothesis>& all) {
  const Rigid3 left = rig.left.body_from_cam, right = rig.right.body_from_cam;
  const auto add = [&](const char* mistake, const Rigid3& new_left, const Rigid3& new_right) {
    StereoRig changed = rig;
    changed.left.body_from_cam = new_left;
    changed.right.body_from_cam = new_right;
    all.push_back({RigFault::kInverted, mistake, changed});
  };
  add("the left camera's extrinsic is the inverse of the one needed", left.Inverse(), right);
  add("the right camera's extrinsic is the inverse of the one needed", left, right.Inverse());
  add("both cameras' extrinsics are the inverse of those needed (camera from body instead of body "
      "from camera, or the reverse)",
      left.Inverse(), right.Inverse());
  add("the transform between the cameras is the inverse of the one needed", left,
      left * (right.Inverse() * left));
}

void AddDistortions(const StereoRig& rig, std::vector<RigHypothesis>& all) {
  constexpr std::pair<Distortion, const char*> kModels[] = {
      {Distortion::kRadialTangential, "radial-tangential"},
      {Distortion::kEquidistant, "equidistant"},
      {Distortion::kNone, "no distortion at all"}};
  for (const auto& [model, name] : kModels) {
    const bool differs = rig.left.camera.model != model || rig.right.camera.model != model;
    const auto is_zero = [](double k) { return k == 0; };
    const auto& k = rig.left.camera.coefficients;
    if (!differs || std::all_of(k.begin(), k.end(), is_zero)) continue;
    StereoRig changed = rig;
    changed.left.camera.model = changed.right.camera.model = model;
    all.push_back({RigFault::kDistortion,
                   fmt::format("the images agree with the model \"{}\" instead", name), changed});
  }
}

std::string ScaleText(double scale) {
  return scale >= 1 ? fmt::format("images {:.3g} times smaller", scale)
                    : fmt::format("images {:.3g} times larger", 1 / scale);
}

// Median epipolar error of thirds of the matches by their distance from the left principal point.
std::vector<RadiusRing> Rings(const StereoRig& rig, const RawMatches& matches,
                              std::span<const RayMatch> rays, const RigFit& fit) {
  std::vector<std::pair<double, double>> by_radius;
  const Pinhole& camera = rig.left.camera.pinhole;
  std::size_t k = 0;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    if (!rays[i].valid) continue;
    const Eigen::Vector2d offset = matches.matches[i].left - Eigen::Vector2d(camera.cx, camera.cy);
    by_radius.emplace_back(offset.norm(), fit.pixels[k++]);
  }
  std::sort(by_radius.begin(), by_radius.end());
  std::vector<RadiusRing> rings;
  constexpr std::size_t kRings = 3;
  for (std::size_t r = 0; r < kRings && by_radius.size() >= kRings; ++r) {
    const std::size_t begin = r * by_radius.size() / kRings;
    const std::size_t end = (r + 1) * by_radius.size() / kRings;
    std::vector<double> errors;
    for (std::size_t i = begin; i < end; ++i) errors.push_back(by_radius[i].second);
    rings.push_back(
        {by_radius[end - 1].first, AbsoluteQuantile(errors, 0.5), static_cast<int>(end - begin)});
  }
  return rings;
}

class Diagnoser {
 public:
  Diagnoser(const StereoRig& rig, const RawMatches& matches, const ShiftedMatches& shifted)
      : rig_(rig), matches_(matches), shifted_(shifted), rays_(ToRays(rig, matches.matches)) {
    std::copy_if(rays_.begin(), rays_.end(), std::back_inserter(moving_),
                 [](const RayMatch& ray) { return ray.valid && ray.has_velocity; });
  }

  RigDiagnosis Run() {
    Measure();
    if (const auto scale = ScaleOfPrincipalPoints(rig_)) {
      return Conclude(RigFault::kResolution,
                      fmt::format("wrong resolution: the principal points lie where those of {} "
                                  "would; multiply the intrinsics by {:.3g}",
                                  ScaleText(*scale), *scale));
    }
    if (result_.calibrated.size() < kMinMatches) {
      return Conclude(RigFault::kTooFewMatches,
                      fmt::format("nothing can be said: only {} points were matched between left "
                                  "and right images, {} are needed",
                                  result_.calibrated.size(), kMinMatches));
    }
    if (IsRight()) return Conclude(RigFault::kNone, "");
    const Explanation best = BestExplanation();
    return Conclude(best.fault, best.text);
  }

 private:
  void Measure();
  bool IsRight() const {
    return result_.behind <= 0.5 && result_.systematic <= result_.allowed &&
           result_.calibrated.noise <= tolerance_;
  }
  Explanation BestExplanation();
  Explanation BestHypothesis() const;
  Explanation BestCorrection();
  Explanation BestShift() const;
  Explanation OfTurn() const;
  Explanation OfRadial() const;
  Explanation OfDelay() const;

  RigDiagnosis Conclude(RigFault fault, const std::string& sentence) {
    result_.fault = fault;
    result_.sentence = sentence;
    return std::move(result_);
  }

  const StereoRig& rig_;
  const RawMatches& matches_;
  const ShiftedMatches& shifted_;
  const std::vector<RayMatch> rays_;
  std::vector<RayMatch> moving_;  // those that tell of a delay
  const double tolerance_ = StereoMatchingOptions().max_row_difference;

  struct Evaluated {
    RigHypothesis hypothesis;
    RigFit fit;
  };
  std::vector<Evaluated> hypotheses_;
  RigFit radial_, moving_before_;
  RigDiagnosis result_;
};

void Diagnoser::Measure() {
  result_.calibrated = FitRig(rig_, rays_, {});
  result_.turned = FitRig(rig_, rays_, {.turn = true});
  result_.delayed = FitRig(rig_, moving_, {.delay = true});
  moving_before_ = FitRig(rig_, moving_, {});
  radial_ = FitRig(rig_, rays_, {.radial = true});
  const RigFit all = FitRig(rig_, rays_, {.turn = true, .radial = true, .delay = true});
  result_.noise =
      std::min({result_.calibrated.noise, result_.turned.noise, radial_.noise, all.noise});
  if (result_.delayed.size() >= kMinMoving) {
    result_.noise = std::min(result_.noise, result_.delayed.noise);
  }
  for (RigHypothesis& hypothesis : RigHypotheses(rig_)) {
    const std::vector<RayMatch> rays = ToRays(hypothesis.rig, matches_.matches);
    RigFit fit = FitRig(hypothesis.rig, rays, {});
    // One that cannot show most of the matches says nothing.
    if (2 * fit.size() < static_cast<int>(rays.size())) continue;
    result_.noise = std::min(result_.noise, fit.noise);
    hypotheses_.push_back({std::move(hypothesis), std::move(fit)});
  }
  result_.systematic = SystematicError(result_.calibrated, all);
  const double noise_90 = 1.645 * result_.noise;
  result_.allowed = std::max(
      result_.noise, std::sqrt(std::max(0.0, tolerance_ * tolerance_ - noise_90 * noise_90)));
  result_.behind = result_.calibrated.BehindShare(result_.noise);
  result_.rings = Rings(rig_, matches_, rays_, result_.calibrated);
}

Explanation Diagnoser::BestHypothesis() const {
  Explanation best{RigFault::kUnexplained, "", 9, 0};
  for (const Evaluated& h : hypotheses_) {
    const double cost = h.fit.Cost(result_.noise);
    if (cost >= best.cost) continue;
    best = {h.hypothesis.fault, h.hypothesis.mistake, cost, AbsoluteQuantile(h.fit.pixels, 0.5)};
  }
  bool swapped = false, inverted = false;
  for (const Evaluated& h : hypotheses_) {
    if (h.fit.Cost(result_.noise) > kSameCost * best.cost) continue;
    swapped |= h.hypothesis.fault == RigFault::kSwapped;
    inverted |= h.hypothesis.fault == RigFault::kInverted;
  }
  // The reader of rectified calibrations has seen that the right camera stands on the right.
  if (rig_.already_rectified) inverted = false;
  const char* name = swapped && inverted ? "swapped cameras or an inverted extrinsic"
                     : swapped           ? "swapped cameras"
                     : inverted          ? "inverted extrinsic"
                     : best.fault == RigFault::kDistortion ? "wrong distortion model"
                                                           : "wrong resolution";
  if (swapped && inverted) {  // one and the same relation of two cameras that are else alike
    best.fault = RigFault::kSwapped;
    best.text =
        "the cameras or their extrinsics are exchanged, or the transform between them inverted";
  }
  best.text =
      fmt::format("{}: {}; then the rows agree within {:.2f} px, now within {:.2f} px", name,
                  best.text, best.median, AbsoluteQuantile(result_.calibrated.pixels, 0.5));
  if (result_.behind > 0.5) {
    best.text += fmt::format(", and {:.0f} % of the points seem to lie behind the cameras",
                             100 * result_.behind);
  }
  return best;
}

Explanation Diagnoser::OfTurn() const {
  const Eigen::Vector3d t = kDegrees * result_.turned.correction.turn;
  const double moved = kDegrees * result_.turned.correction.direction.norm();
  return {RigFault::kTurned,
          fmt::format("turned cameras: the right camera stands ({:+.2f}, {:+.2f}, {:+.2f}) degrees "
                      "about its x, y and z off its calibration, the baseline {:.2f} degrees: "
                      "calibrate the extrinsics again",
                      t.x(), t.y(), t.z(), moved),
          result_.turned.Cost(result_.noise), AbsoluteQuantile(result_.turned.pixels, 0.5)};
}

Explanation Diagnoser::OfRadial() const {
  const std::vector<RadiusRing>& rings = result_.rings;
  const std::string growth =
      rings.empty() ? ""
                    : fmt::format(
                          "the rows disagree by {:.2f} px in the middle of the image and "
                          "{:.2f} px at its border; ",
                          rings.front().median, rings.back().median);
  return {
      RigFault::kDistortion,
      fmt::format("wrong distortion model or coefficients: {}rays must be bent by {:+.3f} r^3 "
                  "(left) and {:+.3f} r^3 (right) to agree",
                  growth, radial_.correction.left_radial[0], radial_.correction.right_radial[0]),
      radial_.Cost(result_.noise), AbsoluteQuantile(radial_.pixels, 0.5)};
}

// Matches without a velocity take no part: the cost is scaled to that of all.
Explanation Diagnoser::OfDelay() const {
  const double before = moving_before_.Cost(result_.noise);
  const double gain = before > 0 ? result_.delayed.Cost(result_.noise) / before : 1;
  const double ms = 1e3 * result_.delayed.correction.delay;
  return {
      RigFault::kUnsynchronised,
      fmt::format("unsynchronised cameras: the right images are taken {:.1f} ms {} than the "
                  "left ones (standard deviation {:.1f} ms): the rows disagree with the motion",
                  std::abs(ms), ms > 0 ? "later" : "earlier", 1e3 * result_.delayed.sigma.delay),
      gain * result_.calibrated.Cost(result_.noise), AbsoluteQuantile(result_.delayed.pixels, 0.5)};
}

Explanation Diagnoser::BestCorrection() {
  Explanation best = OfTurn();
  for (const Explanation& other : {OfRadial(), OfDelay()}) {
    const bool can_tell =
        other.fault != RigFault::kUnsynchronised || result_.delayed.size() >= kMinMoving;
    if (can_tell && other.cost < best.cost) best = other;
  }
  return best;
}

// The right images of other frames.
Explanation Diagnoser::BestShift() const {
  Explanation best{RigFault::kUnexplained, "", 9, 0};
  for (int shift = -kMaxShift; shift <= kMaxShift; ++shift) {
    if (shift == 0) continue;
    const RawMatches matches = shifted_(shift);
    const RigFit fit = FitRig(rig_, ToRays(rig_, matches.matches), {});
    if (fit.size() < kMinMatches || fit.Cost(result_.noise) >= best.cost) continue;
    best = {RigFault::kUnsynchronised,
            fmt::format("unsynchronised cameras: the right images agree with the left ones of {} "
                        "frame{} {} (within {:.2f} px instead of {:.2f} px)",
                        std::abs(shift), std::abs(shift) == 1 ? "" : "s",
                        shift > 0 ? "earlier" : "later", AbsoluteQuantile(fit.pixels, 0.5),
                        AbsoluteQuantile(result_.calibrated.pixels, 0.5)),
            fit.Cost(result_.noise), AbsoluteQuantile(fit.pixels, 0.5)};
  }
  return best;
}

Explanation Diagnoser::BestExplanation() {
  const double now = result_.calibrated.Cost(result_.noise);
  Explanation best = BestHypothesis();
  const Explanation shift = BestShift();
  if (shift.cost < best.cost) best = shift;
  if (result_.behind <= 0.5) {
    const Explanation correction = BestCorrection();
    if (correction.cost * kAdvantage < best.cost) best = correction;
  }
  if (best.cost < kExplained * now) return best;
  return {RigFault::kUnexplained,
          fmt::format("wrong calibration: the rows of left and right images disagree by {:.2f} px "
                      "(median), and no single known mistake explains it: calibrate the rig again",
                      AbsoluteQuantile(result_.calibrated.pixels, 0.5)),
          now, 0};
}

}  // namespace

std::string ToString(RigFault fault) {
  switch (fault) {
    case RigFault::kNone:
      return "none";
    case RigFault::kTooFewMatches:
      return "too few matches";
    case RigFault::kResolution:
      return "resolution";
    case RigFault::kSwapped:
      return "swapped";
    case RigFault::kInverted:
      return "inverted";
    case RigFault::kDistortion:
      return "distortion";
    case RigFault::kUnsynchronised:
      return "unsynchronised";
    case RigFault::kTurned:
      return "turned";
    case RigFault::kUnexplained:
      break;
  }
  return "unexplained";
}

std::vector<RigHypothesis> RigHypotheses(const StereoRig& rig) {
  std::vector<RigHypothesis> all;
  StereoRig changed = rig;
  std::swap(changed.left, changed.right);
  all.push_back({RigFault::kSwapped,
                 "what is called the left camera is the right one, and the reverse", changed});
  changed = rig;
  std::swap(changed.left.body_from_cam, changed.right.body_from_cam);
  all.push_back({RigFault::kSwapped, "the extrinsics of the two cameras are exchanged", changed});
  AddInverted(rig, all);
  AddDistortions(rig, all);
  for (const double scale : kUsualScales) {
    all.push_back({RigFault::kResolution,
                   fmt::format("the intrinsics are those of {}; multiply them by {:.3g}",
                               ScaleText(scale), scale),
                   Scaled(rig, scale)});
  }
  return all;
}

std::optional<double> ScaleOfPrincipalPoints(const StereoRig& rig) {
  constexpr double kLeast = 1.25, kSpread = 1.1;
  double least = 1e9, largest = 0;
  for (const Pinhole& p : {rig.left.camera.pinhole, rig.right.camera.pinhole}) {
    for (const double scale : {0.5 * p.width / (p.cx + 0.5), 0.5 * p.height / (p.cy + 0.5)}) {
      if (!(scale > 0)) return std::nullopt;
      least = std::min(least, scale);
      largest = std::max(largest, scale);
    }
  }
  double scale = std::sqrt(least * largest);
  if (largest > kSpread * least || (scale < kLeast && scale > 1 / kLeast)) return std::nullopt;
  for (const double usual : kUsualScales) {
    if (std::abs(std::log(scale / usual)) < std::log(kSpread)) return usual;
  }
  return scale;
}

RigDiagnosis DiagnoseRig(const StereoRig& rig, const RawMatches& matches,
                         const ShiftedMatches& shifted) {
  return Diagnoser(rig, matches, shifted).Run();
}

}  // namespace airslam
