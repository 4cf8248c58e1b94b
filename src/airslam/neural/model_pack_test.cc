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
  EXPECT_EQ(pack.features.descriptors, "descriptors");
  EXPECT_EQ(pack.features.scores, "score_logits");
  EXPECT_EQ(pack.features.descriptor_size, 4);
  EXPECT_EQ(pack.features.descriptor_stride, 4);
  EXPECT_TRUE(pack.features.half_pixel);
  EXPECT_EQ(pack.features.score_threshold, -5);
  EXPECT_EQ(pack.features.nms_radius, 2);
  ASSERT_TRUE(pack.features.lines.has_value());
  const LineNetworkSpec& lines = *pack.features.lines;
  EXPECT_EQ(lines.network.path, (folder_ / "plnet_lines.onnx").string());
  EXPECT_EQ(lines.field, "line_field");
  EXPECT_EQ(lines.junctions, "junction_maps");
  EXPECT_EQ(lines.pooled, "line_features");
  EXPECT_EQ(lines.channels, 2);
  EXPECT_EQ(lines.samples, 4);
  EXPECT_EQ(lines.classifier.path, (folder_ / "line_classifier.onnx").string());
  EXPECT_EQ(lines.classifier_input, "features");
  EXPECT_EQ(lines.classifier_output, "logits");
  EXPECT_EQ(lines.decoder.stride, 4);
  EXPECT_EQ(lines.decoder.reach, 16);
  EXPECT_EQ(lines.decoder.min_confidence, 0.5F);
  EXPECT_EQ(lines.decoder.min_junction, 0.5F);
  EXPECT_EQ(lines.decoder.max_junctions, 8);
  EXPECT_EQ(lines.decoder.snap, 12);
  EXPECT_EQ(lines.decoder.min_support, 1);
  EXPECT_EQ(lines.decoder.double_radius, 3);
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
  EXPECT_THAT(ErrorWith([](json& m) { m["features"]["lines"]["samples"] = 1; }),
              HasSubstr("'features.lines.samples' is 1, expected an integer from 2"));
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
       {"file", "sha256", "input", "normalization", "multiple", "descriptors", "scores",
        "descriptor_size", "descriptor_stride", "half_pixel", "score_threshold", "nms_radius"}) {
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
  EXPECT_THAT(ErrorWith([](json& m) { m["format"] = 2; }),
              AllOf(HasSubstr("format 2 is unknown"), HasSubstr("reads format 1")));
  EXPECT_THAT(ErrorWith([](json& m) { m["features"]["normalization"] = "none"; }),
              HasSubstr("'features.normalization' is \"none\""));
  EXPECT_THAT(ErrorWith([](json& m) { m["features"]["multiple"] = "16"; }),
              HasSubstr("'features.multiple' is \"16\", expected an integer"));
  EXPECT_THAT(ErrorWith([](json& m) { m["features"]["multiple"] = 6; }),
              HasSubstr("expected a multiple of the descriptor stride 4"));
  EXPECT_THAT(ErrorWith([](json& m) { m["features"]["descriptor_stride"] = 0; }),
              HasSubstr("'features.descriptor_stride' is 0"));
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
