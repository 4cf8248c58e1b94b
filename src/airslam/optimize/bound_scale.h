// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

namespace airslam {

// What the bounds on residuals (of robust losses, of outliers) are multiplied by, from `least` to
// 1: 1.5 times the standard deviation of a coordinate in sigmas, as the median shows it, which the
// worse half of the observations does not raise. Not once, because the residuals of real images
// have longer tails than a normal distribution, and what lies in them is worth its weight.
// `mean_squares`: of each observation the mean of its squared coordinates; without any, and with a
// least scale of 1, it is 1. `lost_freedom`: coordinates / (coordinates - unknowns that were fitted
// to them).
double BoundScale(std::vector<double> mean_squares, double lost_freedom, double least);

}  // namespace airslam
