// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <nanobind/nanobind.h>

namespace airslam::python {

// Each adds one part of the package to the module airslam._core, in a file of its own. Conventions
// of all of them: poses are 4x4 float64 matrices [R t; 0 1], named b_from_a, lengths in metres;
// times are integer nanoseconds; pixels are x right, y down, integer at pixel centres; images are
// uint8 arrays of height x width. What the C++ core throws as airslam::Error arrives as
// airslam.Error with the same sentence. Long calls release the GIL.
void BindRig(nanobind::module_& module);
void BindTrajectory(nanobind::module_& module);
void BindFrame(nanobind::module_& module);
void BindMap(nanobind::module_& module);
void BindOdometry(nanobind::module_& module);
void BindRefinement(nanobind::module_& module);
void BindDetection(nanobind::module_& module);
void BindLocalization(nanobind::module_& module);
void BindEvaluation(nanobind::module_& module);

}  // namespace airslam::python
