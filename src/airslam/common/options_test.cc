// SPDX-License-Identifier: BSD-3-Clause
#include "airslam/common/options.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>

namespace airslam {
namespace {

using ::testing::HasSubstr;

struct TrackingOptions {
  int max_keypoints = 350;
  double parallax_ratio = 0.1;
  bool use_right_image = true;

  template <class V>
  void Visit(V& v) {
    v.Field("max_keypoints", max_keypoints);
    v.Field("parallax_ratio", parallax_ratio);
    v.Field("use_right_image", use_right_image);
  }
  void Validate() const {
    RequireOption(max_keypoints > 0, "tracking.max_keypoints", max_keypoints, "must be at least 1");
  }
};

struct RunOptions {
  std::string pack = "default";
  float threshold = 0.2f;
  TrackingOptions tracking;

  template <class V>
  void Visit(V& v) {
    v.Field("pack", pack);
    v.Field("threshold", threshold);
    v.Group("tracking", tracking);
  }
  void Validate() const { tracking.Validate(); }
};

class OptionsTest : public testing::Test {
 protected:
  ~OptionsTest() override { std::filesystem::remove(file_); }

  void Load(const std::string& text, RunOptions& options) {
    std::ofstream(file_) << text;
    LoadOptions(file_, options);
  }

  // The sentence that loading `text` fails with, less the file's name; empty when it does not.
  std::string ErrorOf(const std::string& text) {
    RunOptions options;
    try {
      Load(text, options);
    } catch (const Error& error) {
      const std::string what = error.what();
      EXPECT_TRUE(what.starts_with(file_.string())) << what;
      return what.substr(file_.string().size());
    }
    return "";
  }

  const std::filesystem::path file_ =
      std::filesystem::path(testing::TempDir()) /
      (std::string(testing::UnitTest::GetInstance()->current_test_info()->name()) + "_" +
       std::to_string(getpid()) + ".yaml");
};

TEST_F(OptionsTest, SetsWhatIsNamedAndLeavesTheRest) {
  RunOptions options;
  Load("pack: night\ntracking:\n  max_keypoints: 400\n  use_right_image: false\n", options);
  EXPECT_EQ(options.pack, "night");
  EXPECT_EQ(options.threshold, 0.2f);
  EXPECT_EQ(options.tracking.max_keypoints, 400);
  EXPECT_EQ(options.tracking.parallax_ratio, 0.1);
  EXPECT_FALSE(options.tracking.use_right_image);
}

TEST_F(OptionsTest, EmptyFileAndEmptyGroupChangeNothing) {
  EXPECT_EQ(ErrorOf(""), "");
  EXPECT_EQ(ErrorOf("# only a comment\n"), "");
  EXPECT_EQ(ErrorOf("tracking:\n"), "");
}

TEST_F(OptionsTest, UnknownKeyNamesTheNearest) {
  EXPECT_EQ(ErrorOf("pack: a\ntracking:\n  max_keypoint: 400\n"),
            ":3: unknown option 'tracking.max_keypoint'; the nearest known one is "
            "'tracking.max_keypoints'");
  EXPECT_EQ(ErrorOf("treshold: 1\n"),
            ":1: unknown option 'treshold'; the nearest known one is 'threshold'");
}

TEST_F(OptionsTest, KeyInTheWrongGroupFindsItsPlace) {
  EXPECT_THAT(ErrorOf("max_keypoints: 400\n"), HasSubstr("is 'tracking.max_keypoints'"));
  EXPECT_THAT(ErrorOf("traking:\n  max_keypoints: 400\n"), HasSubstr("is 'tracking'"));
}

TEST_F(OptionsTest, WrongTypeNamesFieldAndExpectation) {
  EXPECT_EQ(ErrorOf("tracking:\n  max_keypoints: many\n"),
            ":2: option 'tracking.max_keypoints' must be a whole number, but is 'many'");
  EXPECT_THAT(ErrorOf("tracking:\n  max_keypoints: 1.5\n"), HasSubstr("must be a whole number"));
  EXPECT_THAT(ErrorOf("tracking:\n  max_keypoints: 99999999999\n"), HasSubstr("whole number"));
  EXPECT_THAT(ErrorOf("threshold: .nan\n"), HasSubstr("must be a number, but is '.nan'"));
  EXPECT_THAT(ErrorOf("threshold: [1, 2]\n"), HasSubstr("must be a number, but is '[1, 2]'"));
  EXPECT_THAT(ErrorOf("tracking:\n  use_right_image: 3\n"), HasSubstr("must be true or false"));
  EXPECT_THAT(ErrorOf("pack: {a: b}\n"), HasSubstr("must be text"));
  EXPECT_THAT(ErrorOf("tracking: 3\n"), HasSubstr("'tracking' is a group of options"));
}

TEST_F(OptionsTest, RepeatedKeyIsAnError) {
  EXPECT_EQ(ErrorOf("pack: a\npack: b\n"), ":2: option 'pack' is given twice");
}

TEST_F(OptionsTest, BrokenFiles) {
  EXPECT_THAT(ErrorOf("pack: [a\n"), HasSubstr("not valid YAML"));
  EXPECT_THAT(ErrorOf("- a\n- b\n"), HasSubstr("must hold 'name: value' lines"));
  RunOptions options;
  EXPECT_THROW(LoadOptions("/nonexistent.yaml", options), Error);
}

TEST_F(OptionsTest, ValidationSpeaksForTheFile) {
  EXPECT_EQ(ErrorOf("tracking:\n  max_keypoints: -3\n"),
            ": tracking.max_keypoints = -3 must be at least 1");
}

TEST_F(OptionsTest, DumpReadsBackBitForBit) {
  RunOptions written;
  written.pack = "a: \"b\" # c\n";
  written.threshold = 0.1f + 0.2f;
  written.tracking.parallax_ratio = 1.0 / 3.0;
  written.tracking.use_right_image = false;
  RunOptions read;
  Load(DumpOptions(written), read);
  EXPECT_EQ(read.pack, written.pack);
  EXPECT_EQ(read.threshold, written.threshold);
  EXPECT_EQ(read.tracking.parallax_ratio, written.tracking.parallax_ratio);
  EXPECT_EQ(read.tracking.use_right_image, false);
}

TEST_F(OptionsTest, DumpIsNestedYaml) {
  EXPECT_EQ(DumpOptions(RunOptions()),
            "pack: \"default\"\nthreshold: 0.2\ntracking:\n  max_keypoints: 350\n"
            "  parallax_ratio: 0.1\n  use_right_image: true\n");
}

}  // namespace
}  // namespace airslam
