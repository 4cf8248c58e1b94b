// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include "airslam/refine/map_processor.h"

namespace airslam {

// Whether two keyframes show the same place (paper, section VI-A): their features are matched, the
// pose of `later` is found by PnP-RANSAC from the landmarks that `earlier` sees, then optimized;
// more than min_inliers of them must agree. The same the other way round, from the landmarks of
// `later`, must give the same pose: landmarks of both keyframes are stereo points of their own, so
// a chance agreement of one side is refused by the other. The world frames of the two need not be
// the same.
//
// Nothing when they do not; `refusal`, if asked for, then says why in a word.
std::optional<Loop> VerifyLoop(const Map& map, KeyframeId earlier, KeyframeId later,
                               FeatureMatcher& matcher, const LoopClosureOptions& options,
                               std::string* refusal = nullptr);

}  // namespace airslam
