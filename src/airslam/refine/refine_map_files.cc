// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/refine/refine_map_files.h"

#include <algorithm>
#include <fstream>
#include <map>
#include <memory>
#include <system_error>

#include "airslam/common/atomic_file.h"
#include "airslam/common/error.h"
#include "airslam/dataset/image_file.h"
#include "airslam/map/map_file.h"
#include "airslam/map/write_map.h"
#include "airslam/neural/model_pack.h"
#include "airslam/neural/transformer_matcher.h"
#include "airslam/place/place_index.h"
#include "airslam/refine/join_maps.h"
#include "airslam/refine/loop_picture.h"

namespace airslam {
namespace {

namespace fs = std::filesystem;

// The networks that find loops: those that made the map.
struct Networks {
  std::unique_ptr<FeatureMatcher> matcher;
  std::shared_ptr<const Vocabulary> vocabulary;
};

Networks LoadNetworks(const Map& map, const RefineRequest& request) {
  const ModelPack pack =
      LoadModelPack(request.model_pack.empty() ? map.model_pack : request.model_pack);
  if (pack.features.network.sha256 != map.model_pack_sha256) {
    Fail("map {} was made with other weights than those of model pack {}",
         request.maps.front().string(), pack.name);
  }
  Networks networks;
  if (pack.matcher) {
    networks.matcher =
        std::make_unique<TransformerMatcher>(*pack.matcher, pack.features.descriptor_size);
  }
  if (pack.vocabulary) networks.vocabulary = LoadVocabulary(pack);
  return networks;
}

// A map that is its own output would be lost if anything went wrong with it.
void RequireOtherFile(const fs::path& input, const fs::path& output) {
  std::error_code error;
  if (fs::equivalent(input, output, error)) {
    Fail("the output is the input {}, which is never changed", input.string());
  }
}

// The maps of all sessions in one, and where each one's keyframes begin.
struct Sessions {
  Map map;
  std::vector<KeyframeId> begins;
};

Sessions ReadSessions(const RefineRequest& request) {
  Sessions sessions;
  Map& map = sessions.map;
  for (const fs::path& given : request.maps) {
    const fs::path file = MapFilePath(given);
    sessions.begins.push_back(map.keyframes.empty() ? 0 : map.keyframes.rbegin()->first + 1);
    if (sessions.begins.size() == 1) {
      map = ReadMap(file);
      if (map.keyframes.empty()) Fail("map {} holds no keyframe", given.string());
    } else {
      AppendMap(ReadMap(file), map, request.maps.front().string(), given.string());
    }
  }
  return sessions;
}

// Whether a place of every session was found again.
void RequireJoined(const Sessions& sessions, const std::vector<fs::path>& names) {
  const auto& keyframes = sessions.map.keyframes;
  const int component = keyframes.begin()->second.component;
  for (std::size_t i = 1; i < names.size(); ++i) {
    const auto begin = keyframes.lower_bound(sessions.begins[i]);
    const auto end =
        i + 1 < names.size() ? keyframes.lower_bound(sessions.begins[i + 1]) : keyframes.end();
    if (std::none_of(begin, end, [&](const auto& k) { return k.second.component == component; })) {
      Fail("no place of {} was found again in {}: the sessions cannot be joined", names[i].string(),
           names.front().string());
    }
  }
}

// Names the files in the report, and writes it with its picture where it is wanted.
void FinishReport(const RefineRequest& request, const Map& map,
                  const std::map<KeyframeId, Rigid3>& before, RefineResult& result) {
  nlohmann::json& report = result.report;
  report["maps"] = nlohmann::json::array();
  for (const fs::path& given : request.maps) report["maps"].push_back(given.string());
  report["out"] = request.out.string();
  if (request.report.empty()) return;
  const fs::path picture = fs::path(request.report).replace_extension(".png");
  WritePicture(picture, DrawLoops(map, before, result.loops));
  report["picture"] = picture.string();
  AtomicFile file(request.report);
  std::ofstream stream(file.partial());
  stream << report.dump(2) << '\n';
  stream.close();
  if (!stream) Fail("the report cannot be written to {}", request.report.string());
  file.Commit();
}

}  // namespace

RefineResult RefineMapFiles(const RefineRequest& request, const RefineObserver& observer) {
  request.options.Validate();
  if (request.maps.empty()) Fail("no map to refine was named");
  for (const fs::path& given : request.maps) RequireOtherFile(MapFilePath(given), request.out);
  // These say now, not after the work, what cannot be written.
  const AtomicFile place(request.out);
  if (!request.report.empty()) AtomicFile(request.report);
  Sessions sessions = ReadSessions(request);
  Map& map = sessions.map;
  const Networks networks = LoadNetworks(map, request);
  std::map<KeyframeId, Rigid3> before;
  for (const auto& [id, keyframe] : map.keyframes) before[id] = keyframe.world_from_cam;
  RefineResult result =
      RefineMap(request.options, {networks.matcher.get(), networks.vocabulary}, map, observer);
  RequireJoined(sessions, request.maps);
  WriteMap(map, result.place, request.out);
  FinishReport(request, map, before, result);
  return result;
}

}  // namespace airslam
