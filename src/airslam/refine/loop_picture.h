// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "airslam/refine/map_processor.h"

namespace airslam {

// A picture (CV_8UC3) of the keyframes' path from the side where it is widest, from above when the
// robot drives on a floor: landmarks grey, the path before refining orange and after it blue, loops
// red. The legend says the scale. `before`: world_from_cam of keyframes before refining.
cv::Mat DrawLoops(const Map& map, const std::map<KeyframeId, Rigid3>& before,
                  const std::vector<Loop>& loops);

}  // namespace airslam
