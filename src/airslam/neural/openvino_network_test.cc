// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/neural/openvino_network.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stdlib.h>
#include <unistd.h>

#include <clocale>
#include <filesystem>
#include <fstream>
#include <functional>
#include <thread>

#include "airslam/common/error.h"

namespace airslam {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

const std::string kData = AIRSLAM_SOURCE_DIR "/src/airslam/neural/testdata";
const std::string kPlNet = kData + "/planes.onnx";
const std::string kStage0 = kData + "/pack/matcher_stage0.onnx";

std::string ErrorOf(const std::function<void()>& action) {
  try {
    action();
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

// Exact arithmetic and no files outside the test.
OpenVinoOptions Plain() {
  OpenVinoOptions options;
  options.precision = Precision::kF32;
  options.cache_folder.clear();
  return options;
}

std::vector<float> Ramp(int count) {
  std::vector<float> values(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) values[static_cast<std::size_t>(i)] = static_cast<float>(i % 97);
  return values;
}

std::vector<float> Descriptors(Network& network, const std::vector<float>& image,
                               const TensorShape& shape) {
  const NamedTensor input{"image", {image.data(), shape}};
  network.Run({&input, 1});
  const TensorView output = network.Output("descriptors");
  return {output.data, output.data + ElementCount(output.shape)};
}

TEST(OpenVinoNetwork, ComputesAfterReshapingOnce) {
  const auto network = LoadOpenVinoNetwork(kPlNet, {{"image", {1, 1, 16, 32}}}, Plain());
  ASSERT_EQ(network->inputs().size(), 1U);
  EXPECT_EQ(network->inputs()[0].name, "image");
  EXPECT_EQ(network->inputs()[0].shape, (TensorShape{1, 1, 16, 32}));
  EXPECT_EQ(network->OutputPort("descriptors").shape, (TensorShape{1, 4, 4, 8}));
  EXPECT_EQ(network->OutputPort("score_logits").shape, (TensorShape{1, 1, 16, 32}));
  const std::vector<float> image = Ramp(16 * 32);
  const std::vector<float> descriptors = Descriptors(*network, image, {1, 1, 16, 32});
  float mean = 0;  // of the second cell of the first row
  for (int y = 0; y < 4; ++y) {
    for (int x = 4; x < 8; ++x) mean += image[static_cast<std::size_t>(y * 32 + x)] / 16;
  }
  EXPECT_NEAR(descriptors[1], mean, 1e-4);
  EXPECT_EQ(descriptors[4 * 8 + 1], 1);
}

TEST(OpenVinoNetwork, KeepsDynamicShapes) {
  const auto network = LoadOpenVinoNetwork(kPlNet, {}, Plain());
  EXPECT_EQ(network->inputs()[0].shape, (TensorShape{1, 1, -1, -1}));
  for (const int height : {8, 24}) {
    EXPECT_EQ(Descriptors(*network, Ramp(height * 16), {1, 1, height, 16}).size(),
              static_cast<std::size_t>(4 * (height / 4) * 4));
    EXPECT_EQ(network->Output("descriptors").shape, (TensorShape{1, 4, height / 4, 4}));
  }
}

TEST(OpenVinoNetwork, EqualInputsGiveEqualBits) {
  OpenVinoOptions options;  // with the precision that is used in earnest
  options.cache_folder.clear();
  const std::vector<float> image = Ramp(64 * 96);
  const TensorShape shape = {1, 1, 64, 96};
  const auto network = LoadOpenVinoNetwork(kPlNet, {{"image", shape}}, options);
  const std::vector<float> first = Descriptors(*network, image, shape);
  EXPECT_EQ(Descriptors(*network, image, shape), first);
  const auto again = LoadOpenVinoNetwork(kPlNet, {{"image", shape}}, options);
  EXPECT_EQ(Descriptors(*again, image, shape), first);
}

// OpenVINO changes the locale while it compiles.
TEST(OpenVinoNetwork, LoadingOnManyThreadsLeavesTheLocale) {
  ASSERT_NE(std::setlocale(LC_CTYPE, "C.UTF-8"), nullptr);
  OpenVinoOptions options;
  const fs::path cache = fs::temp_directory_path() / fmt::format("airslam_locale_{}", getpid());
  options.cache_folder = cache.string();
  {
    std::vector<std::jthread> threads;
    for (int i = 0; i < 4; ++i) {
      threads.emplace_back([&options, i] {
        for (int k = 1; k <= 6; ++k) {
          LoadOpenVinoNetwork(kPlNet, {{"image", {1, 1, 16 * (i + 1), 16 * k}}}, options);
        }
      });
    }
  }
  fs::remove_all(cache);
  EXPECT_STREQ(std::setlocale(LC_CTYPE, nullptr), "C.UTF-8");
  std::setlocale(LC_CTYPE, "C");
}

TEST(OpenVinoNetwork, SaysWhichInputIsWrong) {
  const auto network = LoadOpenVinoNetwork(kPlNet, {{"image", {1, 1, 16, 32}}}, Plain());
  const std::vector<float> image = Ramp(16 * 32);
  const NamedTensor good{"image", {image.data(), {1, 1, 16, 32}}};
  const NamedTensor wrong_name{"picture", {image.data(), {1, 1, 16, 32}}};
  const NamedTensor wrong_shape{"image", {image.data(), {1, 1, 32, 16}}};
  const std::vector<NamedTensor> twice = {good, good};
  EXPECT_THAT(ErrorOf([&] {
                network->Run({&wrong_name, 1});
              }),
              AllOf(HasSubstr("planes.onnx"), HasSubstr("no input 'picture'; it has 'image'")));
  EXPECT_THAT(ErrorOf([&] {
                network->Run({&wrong_shape, 1});
              }),
              HasSubstr("'image' was given with the shape 1x1x32x16, expected 1x1x16x32"));
  EXPECT_THAT(ErrorOf([&] { network->Run({}); }),
              HasSubstr("the input 'image' (1x1x16x32) was not given"));
  EXPECT_THAT(ErrorOf([&] { network->Run(twice); }), HasSubstr("'image' was given twice"));
  std::vector<float> memory(7);
  const NamedBuffer too_small{"score_logits", memory};
  EXPECT_THAT(ErrorOf([&] {
                network->Run({twice.data(), 1}, {&too_small, 1});
              }),
              HasSubstr("the output 'score_logits' (1x1x16x32) was given memory for 7 values"));
  EXPECT_THAT(ErrorOf([&] { network->Output("lines"); }),
              HasSubstr("no output 'lines'; it has 'descriptors', 'score_logits'"));
  EXPECT_THAT(ErrorOf([&] {
                network->RequireOutput("descriptors", {1, 64, 4, 8});
              }),
              HasSubstr("output 'descriptors' has the shape 1x4x4x8, expected 1x64x4x8"));
  EXPECT_EQ(ErrorOf([&] { network->RequireOutput("descriptors", {1, -1, 4, 8}); }), "");
}

TEST(OpenVinoNetwork, SaysWhyAFileDoesNotLoad) {
  EXPECT_THAT(ErrorOf([] { LoadOpenVinoNetwork("/no/net.onnx", {}, Plain()); }),
              HasSubstr("/no/net.onnx: no such network file"));
  EXPECT_THAT(ErrorOf([] { LoadOpenVinoNetwork(kData + "/pack/manifest.json", {}, Plain()); }),
              HasSubstr("manifest.json: not a network: expected a file that ends in .onnx"));
  EXPECT_THAT(ErrorOf([] { LoadOpenVinoNetwork(kData + "/integers.onnx", {}, Plain()); }),
              HasSubstr("'x' holds i64, expected f32"));
  EXPECT_THAT(ErrorOf([] {
                LoadOpenVinoNetwork(kPlNet, {{"picture", {1, 1, 8, 8}}}, Plain());
              }),
              HasSubstr("has no input 'picture' to reshape"));
  EXPECT_THAT(ErrorOf([] {
                LoadOpenVinoNetwork(kPlNet, {{"image", {1, 3, 8, 8}}}, Plain());
              }),
              HasSubstr("does not accept the input shapes 'image' 1x3x8x8"));
  OpenVinoOptions options;
  options.threads = 0;
  EXPECT_THAT(ErrorOf([&] { LoadOpenVinoNetwork(kPlNet, {}, options); }),
              HasSubstr("threads is 0"));
}

class CacheTest : public testing::Test {
 protected:
  CacheTest() {
    std::string folder = (fs::temp_directory_path() / "airslam_cache_XXXXXX").string();
    if (mkdtemp(folder.data()) == nullptr) throw std::runtime_error("mkdtemp");
    folder_ = folder;
    for (const char* name : {"XDG_CACHE_HOME", "HOME"}) {
      const char* value = std::getenv(name);
      saved_.emplace_back(name, value == nullptr ? "" : value);
    }
  }
  ~CacheTest() override {
    fs::remove_all(folder_);
    for (const auto& [name, value] : saved_) {
      value.empty() ? unsetenv(name.c_str()) : setenv(name.c_str(), value.c_str(), 1);
    }
  }

  fs::path folder_;
  std::vector<std::pair<std::string, std::string>> saved_;
};

TEST_F(CacheTest, KeepsCompiledNetworksAndTheSameBits) {
  OpenVinoOptions options;
  options.cache_folder = (folder_ / "made" / "on the way").string();
  const TensorShape shape = {1, 1, 64, 96};
  const std::vector<float> image = Ramp(64 * 96);
  const auto load = [&] { return LoadOpenVinoNetwork(kPlNet, {{"image", shape}}, options); };
  const std::vector<float> fresh = Descriptors(*load(), image, shape);
  EXPECT_FALSE(fs::is_empty(options.cache_folder));
  EXPECT_EQ(Descriptors(*load(), image, shape), fresh);  // now from the cache
  for (const auto& entry : fs::directory_iterator(options.cache_folder)) {
    fs::permissions(entry.path(), fs::perms::owner_write, fs::perm_options::add);
    fs::resize_file(entry.path(), fs::file_size(entry.path()) / 2);  // a write that was cut short
  }
  EXPECT_EQ(Descriptors(*load(), image, shape), fresh);
}

TEST_F(CacheTest, DoesWithoutWhenTheFolderCannotBeMade) {
  std::ofstream(folder_ / "file") << "in the way";
  OpenVinoOptions options = Plain();
  options.cache_folder = (folder_ / "file" / "cache").string();
  const auto network = LoadOpenVinoNetwork(kPlNet, {{"image", {1, 1, 8, 8}}}, options);
  EXPECT_EQ(Descriptors(*network, Ramp(64), {1, 1, 8, 8}).size(), 16U);
}

TEST_F(CacheTest, TheDefaultFolderFollowsTheEnvironment) {
  setenv("XDG_CACHE_HOME", (folder_ / "xdg").c_str(), 1);
  EXPECT_EQ(DefaultCacheFolder(), (folder_ / "xdg" / "airslam").string());
  EXPECT_TRUE(fs::is_directory(folder_ / "xdg" / "airslam"));
  unsetenv("XDG_CACHE_HOME");
  setenv("HOME", folder_.c_str(), 1);
  EXPECT_EQ(DefaultCacheFolder(), (folder_ / ".cache" / "airslam").string());
  std::ofstream(folder_ / "file") << "in the way";
  setenv("HOME", (folder_ / "file").c_str(), 1);
  EXPECT_EQ(DefaultCacheFolder(), "");
  unsetenv("HOME");
  EXPECT_EQ(DefaultCacheFolder(), "");
}

TEST(TensorShape, ReadsWell) {
  EXPECT_EQ(ToString({1, 64, -1, 188}), "1x64x?x188");
  EXPECT_EQ(ToString({}), "scalar");
  EXPECT_EQ(ElementCount({2, 3, 4}), 24);
}

}  // namespace
}  // namespace airslam
