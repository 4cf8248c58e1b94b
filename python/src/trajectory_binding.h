// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <utility>

#include "airslam/dataset/trajectory.h"

namespace airslam::python {

// A trajectory that Python reads.
class TrajectoryView {
 public:
  explicit TrajectoryView(Trajectory poses) : poses_(std::move(poses)) {}
  const Trajectory& poses() const { return poses_; }

 private:
  Trajectory poses_;
};

}  // namespace airslam::python
