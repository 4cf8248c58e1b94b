// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/odometry/map_run.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "airslam/common/error.h"
#include "airslam/sensor/temporary_folder.h"
#include "airslam/testing/synthetic_rig.h"

namespace airslam {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using ::testing::HasSubstr;

// The shipped pack with a manifest in which the value at `where` is one too large.
fs::path WrongPack(const TemporaryFolder& folder, const json::json_pointer& where) {
  const fs::path pack = folder.path() / "pack";
  fs::copy(AIRSLAM_SOURCE_DIR "/models/airslam-fast", pack);
  json manifest = json::parse(std::ifstream(pack / "manifest.json"));
  manifest[where] = manifest[where].get<int>() + 1;
  std::ofstream(pack / "manifest.json") << manifest;
  return pack;
}

// All networks are loaded before the first frame, so that a run does not fail in its middle.
TEST(MapRun, ANetworkThatDoesNotFitIsToldAtOnce) {
  const std::pair<const char*, const char*> wrong[] = {
      {"/features/maps/0/channels", "plnet.onnx"},
      {"/features/lines/pooled/0/channels", "line_neck.onnx"},
      {"/matcher/keypoints", "matcher_stage0.onnx"}};
  for (const auto& [where, file] : wrong) {
    const TemporaryFolder folder;
    MapRunRequest request;
    request.out = folder.path() / "out";
    request.model_pack = WrongPack(folder, json::json_pointer(where)).string();
    try {
      const MapRun run(EurocLikeRig(320, 208), request);
      FAIL() << where;
    } catch (const Error& error) {
      EXPECT_THAT(error.what(), HasSubstr(file)) << where;
      EXPECT_THAT(error.what(), HasSubstr("expected")) << where;
    }
    EXPECT_FALSE(fs::exists(request.out)) << where;
  }
}

TEST(MapRun, WithoutLinesTheirNetworkIsNotNeeded) {
  const TemporaryFolder folder;
  MapRunRequest request;
  request.options.lines.enabled = false;
  request.model_pack =
      WrongPack(folder, json::json_pointer("/features/lines/pooled/0/channels")).string();
  EXPECT_NO_THROW(MapRun(EurocLikeRig(320, 208), request));
}

}  // namespace
}  // namespace airslam
