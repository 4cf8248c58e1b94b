// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/neural/make_matcher.h"

#include "airslam/common/log.h"
#include "airslam/neural/nearest_matcher.h"
#include "airslam/neural/transformer_matcher.h"

namespace airslam {

std::unique_ptr<FeatureMatcher> MakeMatcher(const ModelPack& pack) {
  if (pack.matcher) {
    return std::make_unique<TransformerMatcher>(*pack.matcher, pack.features.descriptor_size);
  }
  LogWarn("model pack {} has no matcher: mutual nearest neighbours instead", pack.name);
  return std::make_unique<NearestMatcher>();
}

}  // namespace airslam
