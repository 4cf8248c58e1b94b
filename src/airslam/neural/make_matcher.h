// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>

#include "airslam/neural/feature_matcher.h"
#include "airslam/neural/model_pack.h"

namespace airslam {

// The matcher of a model pack; of a pack without one mutual nearest neighbours, with a warning.
std::unique_ptr<FeatureMatcher> MakeMatcher(const ModelPack& pack);

}  // namespace airslam
