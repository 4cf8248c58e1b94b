// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "airslam/refine/map_processor.h"

// A map processor of one's own: forgets landmarks that too few keyframes see, or that do not lie
// where they are seen.
class RemoveLowQuality : public airslam::MapProcessor {
 public:
  static constexpr int kMinKeyframes = 3;
  static constexpr double kMaxError = 2;  // pixels, mean

  void Process(airslam::Map& map, airslam::RefineContext& context) override;
};
