// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/refine/junction_vocabulary.h"

#include "airslam/place/place_index.h"

namespace airslam {

void JunctionVocabulary::Process(Map& map, RefineContext& context) {
  if (context.vocabulary == nullptr) {
    context.report["skipped"] = "the model pack has no vocabulary";
    return;
  }
  context.progress(0, 2, "junction vocabulary");
  const std::shared_ptr<const Vocabulary> junctions = TrainJunctionVocabulary(map);
  context.progress(1, 2, "words");
  context.place = PlaceIndex(map, context.vocabulary, junctions).Record();
  context.progress(2, 2, "words");
  context.report["junction_words"] = junctions != nullptr ? junctions->words() : 0;
  context.report["keyframes"] = context.place->words.size();
}

}  // namespace airslam
