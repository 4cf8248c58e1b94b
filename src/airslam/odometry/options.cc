// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/options.h"

#include "airslam/common/options.h"

namespace airslam {

void OdometryOptions::Validate() const { RequireRanges(*this); }

}  // namespace airslam
