// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include <span>
#include <vector>

#include "airslam/calibrate/epipolar.h"

namespace airslam {

// Which parts of a RigCorrection are free.
struct FreeParts {
  bool turn = false;    // turn and direction: 5 parameters
  bool radial = false;  // of both cameras: 6
  bool delay = false;   // 1; matches without a velocity tell nothing of it
};

struct RigFit {
  RigCorrection correction;
  RigCorrection sigma;           // standard deviation of each; 0 where not free
  std::vector<double> pixels;    // error of each match that took part, signed
  std::vector<double> parallax;  // the same matches', EpipolarError::parallax
  double noise = 0;              // robust standard deviation of `pixels` (1.4826 * median of |e|)

  int size() const { return static_cast<int>(pixels.size()); }
  // Mean of min((e / sigma)^2, 9), where a match whose rays meet behind a camera by more than three
  // sigma counts 9 as well: about 1 for a right rig and few wrong matches.
  double Cost(double sigma_pixels) const;
  // Share of the matches with a parallax above three sigma either way that meet behind; 0 if none.
  double BehindShare(double sigma_pixels) const;
};

// Fits the free parts to the epipolar errors by iterated weighted least squares (Cauchy weights of
// the current robust scale; a fixed number of steps, numeric derivatives). Weak priors about 0 keep
// what the matches do not tell: 3 degrees for angles, 0.3 for radial terms, 0.2 s for the delay.
// With nothing free it only evaluates. Matches that are not valid are left out.
RigFit FitRig(const StereoRig& rig, std::span<const RayMatch> matches, const FreeParts& parts);

// The 90th percentile of how far a fit moved the epipolar errors of the matches that agree with it
// (within three of its sigmas): what a calibration's error does in the image, without noise.
// `before` is of the same matches.
double SystematicError(const RigFit& before, const RigFit& after);

// The p-quantile of |values|, p in 0..1; 0 for none.
double AbsoluteQuantile(std::span<const double> values, double p);

}  // namespace airslam
