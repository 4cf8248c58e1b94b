// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/neural/model_pack.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>

#include "airslam/common/error.h"
#include "airslam/common/sha256.h"

namespace airslam {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;

constexpr char kPack[] = AIRSLAM_SOURCE_DIR "/src/airslam/neural/testdata/pack";

// What the error says, or "" when there is none.
std::string ErrorOf(const std::function<void()>& action) {
  try {
    action();
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

// A copy of the test pack that may be spoiled.
class ModelPackTest : public testing::Test {
 protected:
  ModelPackTest() {
    std::string folder = (fs::temp_directory_path() / "airslam_pack_XXXXXX").string();
    if (mkdtemp(folder.data()) == nullptr) throw std::runtime_error("mkdtemp");
    folder_ = folder;
    fs::copy(kPack, folder_, fs::copy_options::recursive);
  }
  ~ModelPackTest() override { fs::remove_all(folder_); }

  // Reads the pack with a changed manifest and returns what the error says.
  std::string ErrorWith(const std::function<void(json&)>& change) const {
    std::ifstream in(fs::path(kPack) / "manifest.json");
    json manifest = json::parse(in);
    change(manifest);
    std::ofstream(folder_ / "manifest.json") << manifest.dump();
    return ErrorOf([&] { ReadModelPack(folder_.string()); });
  }

  fs::path folder_;
};

TEST_F(ModelPackTest, KnowsAVocabulary) {
  EXPECT_FALSE(ReadModelPack(folder_.string()).vocabulary.has_value());
  std::ofstream(folder_ / "words.bin") << "words";
  const auto with = [&](const std::string& sha) {
    return ErrorWith([&](json& manifest) {
      manifest["vocabulary"] = {{"file", "words.bin"}, {"sha256", sha}};
    });
  };
  EXPECT_EQ(with(FileSha256(folder_ / "words.bin")), "");
  EXPECT_EQ(ReadModelPack(folder_.string()).vocabulary->path, (folder_ / "words.bin").string());
  EXPECT_THAT(with(std::string(64, '0')), HasSubstr("words.bin: its SHA-256 is"));
}

TEST_F(ModelPackTest, ReadsEveryField) {
  const ModelPack pack = ReadModelPack(folder_.string());
  EXPECT_EQ(pack.name, "test");
  EXPECT_EQ(pack.license, "BSD-3-Clause");
  EXPECT_EQ(pack.sha256, FileSha256(folder_ / "manifest.json"));
  EXPECT_EQ(pack.features.network.path, (folder_ / "plnet.onnx").string());
  EXPECT_EQ(pack.features.input, "image");
  EXPECT_EQ(pack.features.normalization, Normalization::kUnit);
  EXPECT_EQ(pack.features.multiple, 16);
  EXPECT_EQ(pack.features.scores, "score_logits");
  EXPECT_EQ(pack.features.descriptor_size, 4);
  EXPECT_EQ(pack.features.score_stride, 4);
  EXPECT_EQ(pack.features.layout, MapLayout::kCells);
  ASSERT_EQ(pack.features.maps.size(), 2U);
  EXPECT_EQ(pack.features.maps[0].output, "features4");
  EXPECT_EQ(pack.features.maps[0].channels, 4);
  EXPECT_EQ(pack.features.maps[1].stride, 8);
  ASSERT_TRUE(pack.features.descriptor_head.has_value());
  EXPECT_EQ(pack.features.descriptor_head->network.path,
            (folder_ / "descriptor_head.onnx").string());
  EXPECT_EQ(pack.features.descriptor_head->input, "samples");
  EXPECT_EQ(pack.features.descriptor_head->output, "descriptors");
  EXPECT_TRUE(pack.features.half_pixel);
  EXPECT_EQ(pack.features.score_threshold, -5);
  EXPECT_EQ(pack.features.nms_radius, 2);
  ASSERT_TRUE(pack.features.lines.has_value());
  const LineNetworkSpec& lines = *pack.features.lines;
  EXPECT_EQ(lines.network.path, (folder_ / "line_neck.onnx").string());
  EXPECT_EQ(lines.field, "line_field");
  EXPECT_EQ(lines.junctions, "junction_maps");
  ASSERT_EQ(lines.pooled.size(), 2U);
  EXPECT_EQ(lines.pooled[0].map.output, "line_features");
  EXPECT_EQ(lines.pooled[0].map.channels, 2);
  EXPECT_EQ(lines.pooled[0].samples, 4);
  EXPECT_EQ(lines.pooled[1].map.stride, 8);
  EXPECT_EQ(lines.pooled[1].samples, 2);
  EXPECT_TRUE(lines.pooled[0].end_offsets.empty());
  EXPECT_EQ(lines.pooled[1].end_offsets, (std::vector<float>{-8, 2}));
  EXPECT_EQ(lines.classifier.network.path, (folder_ / "line_classifier.onnx").string());
  EXPECT_EQ(lines.classifier.input, "features");
  EXPECT_EQ(lines.classifier.output, "logits");
  EXPECT_EQ(lines.decoder.stride, 4);
  EXPECT_EQ(lines.decoder.reach, 16);
  EXPECT_EQ(lines.decoder.min_confidence, 0.5F);
  EXPECT_EQ(lines.decoder.min_junction, 0.5F);
  EXPECT_EQ(lines.decoder.max_junctions, 8);
  EXPECT_EQ(lines.decoder.snap, 12);
  EXPECT_EQ(lines.decoder.min_support, 1);
  EXPECT_EQ(lines.decoder.double_radius, 3);
  EXPECT_EQ(lines.decoder.overlap_radius, 4);
  EXPECT_EQ(lines.decoder.max_proposals, 16);
  ASSERT_TRUE(pack.matcher.has_value());
  EXPECT_EQ(pack.matcher->keypoints, 8);
  EXPECT_EQ(pack.matcher->threshold, 0.1F);
  EXPECT_EQ(pack.matcher->exit_confidence, 0.9F);
  ASSERT_EQ(pack.matcher->stages.size(), 2U);
  EXPECT_EQ(pack.matcher->stages[1].path, (folder_ / "matcher_stage1.onnx").string());
}

TEST_F(ModelPackTest, TheMatcherMayBeAbsent) {
  EXPECT_EQ(ErrorWith([](json& m) { m.erase("matcher"); }), "");
  EXPECT_FALSE(ReadModelPack(folder_.string()).matcher.has_value());
}

TEST_F(ModelPackTest, TheLineModuleMayBeAbsentButNotWrong) {
  EXPECT_EQ(ErrorWith([](json& m) { m["features"].erase("lines"); }), "");
  EXPECT_FALSE(ReadModelPack(folder_.string()).features.lines.has_value());
  EXPECT_THAT(ErrorWith([](json& m) { m["features"]["lines"].erase("classifier"); }),
              HasSubstr("'features.lines.classifier' is missing"));
  for (const json& wrong : {json(3), json({1, "x"}), json({1e6})}) {
    EXPECT_THAT(
        ErrorWith([&](json& m) { m["features"]["lines"]["pooled"][1]["end_offsets"] = wrong; }),
        HasSubstr("'features.lines.pooled[1].end_offsets' is not a list of at most 1024 numbers"));
  }
  EXPECT_THAT(ErrorWith([](json& m) { m["features"]["lines"]["pooled"][1]["samples"] = 1; }),
              HasSubstr("'features.lines.pooled[1].samples' is 1, expected an integer from 2"));
  EXPECT_THAT(ErrorWith([](json& m) { m["features"]["lines"]["stride"] = 5; }),
              HasSubstr("'features.lines.stride' is 5, expected a divisor"));
  std::ofstream(folder_ / "line_classifier.onnx", std::ios::app) << "x";
  EXPECT_THAT(ErrorWith([](json&) {}),
              AllOf(HasSubstr("line_classifier.onnx"), HasSubstr("SHA-256")));
}

TEST_F(ModelPackTest, NamesWhatIsMissing) {
  for (const char* field : {"format", "name", "license", "features"}) {
    EXPECT_THAT(ErrorWith([&](json& m) { m.erase(field); }),
                HasSubstr(std::string("the field '") + field + "' is missing"));
  }
  for (const char* field :
       {"file", "sha256", "input", "normalization", "multiple", "scores", "score_stride", "layout",
        "maps", "descriptor_size", "half_pixel", "score_threshold", "nms_radius"}) {
    EXPECT_THAT(ErrorWith([&](json& m) { m["features"].erase(field); }),
                HasSubstr(std::string("the field 'features.") + field + "' is missing"));
  }
  for (const char* field : {"keypoints", "threshold", "exit_confidence", "stages"}) {
    EXPECT_THAT(ErrorWith([&](json& m) { m["matcher"].erase(field); }),
                HasSubstr(std::string("the field 'matcher.") + field + "' is missing"));
  }
  EXPECT_THAT(ErrorWith([](json& m) { m["matcher"]["stages"][1].erase("sha256"); }),
              HasSubstr("the field 'matcher.stages[1].sha256' is missing"));
}

TEST_F(ModelPackTest, NamesWhatIsWrong) {
  EXPECT_THAT(ErrorWith([](json& m) { m["format"] = 1; }),
              AllOf(HasSubstr("format 1 is unknown"), HasSubstr("reads format 2")));
  EXPECT_THAT(ErrorWith([](json& m) { m["features"]["normalization"] = "none"; }),
              HasSubstr("'features.normalization' is \"none\""));
  EXPECT_THAT(ErrorWith([](json& m) { m["features"]["multiple"] = "16"; }),
              HasSubstr("'features.multiple' is \"16\", expected an integer"));
  EXPECT_THAT(
      ErrorWith([](json& m) { m["features"]["multiple"] = 6; }),
      HasSubstr("'features.score_stride' is 4, expected a divisor of features.multiple, 6"));
  EXPECT_THAT(ErrorWith([](json& m) { m["features"]["maps"][0]["stride"] = 0; }),
              HasSubstr("'features.maps[0].stride' is 0"));
  EXPECT_THAT(ErrorWith([](json& m) { m["features"]["layout"] = "rows"; }),
              HasSubstr("'features.layout' is \"rows\", expected \"cells\" or \"planes\""));
  EXPECT_THAT(ErrorWith([](json& m) { m["features"]["layout"] = "planes"; }),
              HasSubstr("lines need the maps in the layout \"cells\""));
  EXPECT_THAT(ErrorWith([](json& m) { m["features"].erase("descriptor_head"); }),
              HasSubstr("without 'features.descriptor_head' descriptors are read of one map"));
  EXPECT_THAT(ErrorWith([](json& m) { m["features"]["half_pixel"] = 1; }),
              HasSubstr("'features.half_pixel' is 1, expected true or false"));
  EXPECT_THAT(ErrorWith([](json& m) { m["matcher"]["threshold"] = 1.5; }),
              HasSubstr("'matcher.threshold' is 1.5"));
  EXPECT_THAT(ErrorWith([](json& m) { m["matcher"]["stages"] = json::array(); }),
              HasSubstr("'matcher.stages'"));
  EXPECT_THAT(ErrorWith([](json& m) { m["matcher"] = 3; }),
              HasSubstr("'matcher' is not an object"));
  EXPECT_THAT(ErrorWith([](json& m) { m["features"]["file"] = "../plnet.onnx"; }),
              HasSubstr("expected a plain file name"));
  EXPECT_THAT(ErrorWith([](json& m) { m = json::array(); }), HasSubstr("not a JSON object"));
}

TEST_F(ModelPackTest, NoticesADamagedFile) {
  {
    std::fstream file(folder_ / "matcher_stage0.onnx",
                      std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(100);
    file.put('\x7f');
  }
  EXPECT_THAT(ErrorOf([&] { ReadModelPack(folder_.string()); }),
              AllOf(HasSubstr("matcher_stage0.onnx: its SHA-256 is"), HasSubstr("damaged")));
}

TEST_F(ModelPackTest, NoticesMissingFiles) {
  fs::remove(folder_ / "plnet.onnx");
  EXPECT_THAT(ErrorOf([&] { ReadModelPack(folder_.string()); }),
              HasSubstr("plnet.onnx: no such file"));
  fs::remove(folder_ / "manifest.json");
  EXPECT_THAT(ErrorOf([&] { ReadModelPack(folder_.string()); }),
              HasSubstr("it holds no manifest.json"));
  EXPECT_THAT(ErrorOf([&] { ReadModelPack((folder_ / "nothing").string()); }),
              HasSubstr("no such model pack folder"));
}

TEST_F(ModelPackTest, ReportsBrokenJson) {
  std::ofstream(folder_ / "manifest.json") << "{\"format\": 1,";
  EXPECT_THAT(ErrorOf([&] { ReadModelPack(folder_.string()); }), HasSubstr("not valid JSON"));
}

TEST_F(ModelPackTest, IsFoundByPathOrFromTheProgramsPlace) {
  EXPECT_EQ(FindModelPack(folder_.string()), folder_.string());
  const fs::path program = fs::read_symlink("/proc/self/exe").parent_path();
  const fs::path installed =
      (program / "../share/airslam/models" / folder_.filename()).lexically_normal();
  fs::create_directories(installed.parent_path());
  fs::rename(folder_, installed);
  folder_ = installed;  // removed at the end
  EXPECT_EQ(FindModelPack(installed.filename().string()), installed.string());
}

TEST_F(ModelPackTest, SaysWhereItLooked) {
  EXPECT_THAT(
      ErrorOf([] { FindModelPack("no-such-pack"); }),
      AllOf(HasSubstr("no model pack 'no-such-pack'"),
            HasSubstr("share/airslam/models/no-such-pack"), HasSubstr("/models/no-such-pack")));
  EXPECT_THAT(ErrorOf([] { FindModelPack("/no/such/folder"); }),
              HasSubstr("there is no folder '/no/such/folder'"));
}

}  // namespace
}  // namespace airslam
