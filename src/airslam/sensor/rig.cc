// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/sensor/rig.h"

namespace airslam {

double StereoRig::Baseline() const {
  return (right.body_from_cam.translation - left.body_from_cam.translation).norm();
}

}  // namespace airslam
